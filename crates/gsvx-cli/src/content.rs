//! What `gsvx encode` and `gsvx plan` both take.

use crate::input::Reading;
use crate::size;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use gsvx::{DEFAULT_QUALITY, EncodeOptions, Preset, Steps};
use std::path::PathBuf;
use tune::Layout;

/// Heading of what changes the scene.
pub(crate) const CONTENT: &str = "What is kept";

/// Heading of what is for large scenes.
pub(crate) const LARGE: &str = "Scenes larger than memory";

/// Models, and the stream of them.
#[derive(clap::Args)]
pub(crate) struct SceneArgs {
    /// The trained models, of any format that gsvx convert reads; `-` for standard input. With --part: the plan.
    #[arg(required = true, value_name = "MODEL")]
    pub(crate) inputs: Vec<PathBuf>,
    /// The stream to write; `-` for standard output. A folder for one stream per model; with a name in .gsvx
    /// several models become one scene.
    #[arg(short, long, value_name = "PATH")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) content: Content,
    #[command(flatten)]
    pub(crate) reading: Reading,
    #[command(flatten)]
    pub(crate) room: Room,
    /// Replace an existing output.
    #[arg(long, display_order = 900)]
    pub(crate) force: bool,
}

/// Where the work is done, and with how much.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Room {
    /// Most memory to use, as in 1G; the rest goes to scratch files. [default: as much as the models need, up to a
    /// quarter of the machine's]
    ///
    /// Needs as much room on the disk as the models take, in a folder beside the output. If the run is killed,
    /// the same command goes on from there. The loss is not estimated.
    #[arg(long, value_name = "SIZE", value_parser = size::bytes, hide_short_help = true,
          help_heading = LARGE)]
    pub(crate) memory: Option<u64>,
    /// Folder for scratch files [default: OUTPUT.scratch].
    #[arg(
        long,
        value_name = "FOLDER",
        hide_short_help = true,
        help_heading = LARGE
    )]
    pub(crate) scratch: Option<PathBuf>,
}

/// Quality and content of a stream.
#[derive(clap::Args)]
pub(crate) struct Content {
    /// Quality from 0 (smallest) to 100 (best) [default: 80].
    #[arg(short, long, group = "rate", value_parser = quality)]
    quality: Option<f32>,
    /// A quality by name: 30, 50, 80 or 90.
    #[arg(long, value_name = "NAME", group = "rate", value_parser = presets())]
    preset: Option<Preset>,
    /// Cameras of the training photos: what they see gets more bits.
    ///
    /// A scene folder (COLMAP project, Inria output or transforms.json), a cameras.json, a
    /// transforms.json, or the folder of a COLMAP model.
    #[arg(long, value_name = "PATH")]
    pub(crate) cameras: Option<PathBuf>,
    /// With --cameras: leave out the Gaussians that they see too little of to pay for their bits, and
    /// so all that they do not see.
    ///
    /// Streams are up to 2 % smaller and show the same from places like those of the cameras. From elsewhere
    /// parts may be missing. Without this, the most prominent part of what the cameras hardly see is kept, coarsely.
    #[arg(long, requires = "cameras", hide_short_help = true, help_heading = CONTENT)]
    pub(crate) drop_unseen: bool,
    /// Store a coarse scene first, for viewers that show a scene while it loads.
    #[arg(long, hide_short_help = true, help_heading = CONTENT)]
    lod: bool,
    /// What a web page wants: the preset web if no quality is given, a coarse scene first, small chunks.
    #[arg(long, hide_short_help = true, help_heading = CONTENT)]
    pub(crate) web: bool,
    /// Highest SH degree to keep. With --cameras, the coefficients of lower ones make up for it where the cameras look.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3),
          value_name = "DEGREE", hide_short_help = true, help_heading = CONTENT)]
    max_sh_degree: u8,
}

impl Content {
    /// The preset that was asked for: --web names one, unless there is a quality.
    pub(crate) fn preset(&self) -> Option<Preset> {
        let web = self.web && self.quality.is_none();
        self.preset.or_else(|| web.then_some(Preset::WEB))
    }

    /// The quality that was asked for, or the default.
    pub(crate) fn quality(&self) -> f32 {
        let preset = self.preset().map(|p| p.quality);
        preset.or(self.quality).unwrap_or(DEFAULT_QUALITY)
    }

    /// What an encoder keeps, and the layout of its stream.
    pub(crate) fn options(&self) -> EncodeOptions {
        let code = Layout::of(self.web, self.lod).code();
        let mut options = EncodeOptions { code, ..EncodeOptions::default() };
        options.code.max_sh_degree = self.max_sh_degree;
        options.prepare.drop_unseen = self.drop_unseen;
        options
    }
}

/// What is said of Gaussians that no rasterizer draws.
pub(crate) fn transparent(n: usize) -> String {
    format!("{n} left out that no rasterizer draws (opacity below 1/255)")
}

/// A quality on the command line.
pub(crate) fn quality(text: &str) -> Result<f32, String> {
    let value = text.parse().map_err(|_| "use a number from 0 to 100".to_owned())?;
    Steps::of_quality(value).map_err(|e| e.to_string())?;
    Ok(value)
}

/// Reads the name of a preset.
fn presets() -> impl TypedValueParser<Value = Preset> {
    let help = |p: Preset| format!("{}: quality {}", p.purpose, p.quality);
    let values = Preset::ALL.map(|p| PossibleValue::new(p.name).help(help(p)));
    PossibleValuesParser::new(values).try_map(|name| {
        Preset::ALL.into_iter().find(|p| p.name == name).ok_or_else(|| format!("no preset {name}"))
    })
}
