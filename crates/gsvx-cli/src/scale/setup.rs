//! What is opened before a scene larger than memory is read.

use super::VERSION;
use super::cameras::PlanCameras;
use super::inputs::SceneFile;
use super::scratch::Scratch;
use crate::content::SceneArgs;
use crate::exit::note;
use crate::output::{Output, is_stdio};
use anyhow::Result;
use gsvx::Choices;
use indicatif::DecimalBytes;
use std::time::Instant;

/// The output, the cameras and the scratch files.
pub(super) struct Setup {
    pub(super) output: Output,
    pub(super) start: Instant,
    pub(super) cameras: Option<PlanCameras>,
    pub(super) scratch: Scratch,
}

impl Setup {
    /// For all models of a scene; `what` tells this work from other work on them.
    pub(super) fn new(args: &SceneArgs, choices: Choices, what: &str) -> Result<Self> {
        let output = Output::open(&args.output, args.force, &args.inputs)?;
        let start = Instant::now();
        let cameras = args.content.cameras.as_deref().map(PlanCameras::read).transpose()?;
        let mut key = format!("gsvx {VERSION} {what}\n");
        let file = cameras.as_ref().map(PlanCameras::file);
        key += &serde_json::to_string(&(&args.reading, choices, file))?;
        key.push('\n');
        for path in &args.inputs {
            key += &SceneFile::new(path)?.key();
        }
        Ok(Self { output, start, cameras, scratch: scratch(args, &key)? })
    }

    /// Says how much room is needed, as far as the lengths of the files tell, and checks it.
    pub(super) fn state_room(&self, args: &SceneArgs) -> Result<()> {
        let scratch = &self.scratch;
        let bytes =
            args.inputs.iter().map(|p| Ok(SceneFile::new(p)?.bytes)).sum::<Result<u64>>()?;
        if !scratch.resumed {
            let (size, folder) = (DecimalBytes(bytes), scratch.path(""));
            note(format_args!("scratch files: about {size} in {}", folder.display()));
        }
        scratch.check_room(bytes)
    }
}

/// The folder for scratch files of the work that `key` tells from other work.
pub(super) fn scratch(args: &SceneArgs, key: &str) -> Result<Scratch> {
    let beside = || match is_stdio(&args.output) {
        true => "gsvx.scratch".into(),
        false => args.output.with_added_extension("scratch"),
    };
    let dir = args.room.scratch.clone().unwrap_or_else(beside);
    let scratch = Scratch::open(&dir, key)?;
    if scratch.resumed {
        note(format_args!("going on with what is in {}", dir.display()));
    }
    Ok(scratch)
}
