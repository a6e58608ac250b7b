//! `gsvx view`: serves the viewer page and the files on the loopback address.

mod answer;
mod request;
mod server;
mod start;
mod stream_maker;

use crate::exit::note;
use crate::input;
use crate::interrupt;
use crate::report::Reporter;
use crate::size;
use answer::AnswerPost;
use anyhow::{Context, Result, anyhow, ensure};
use gs_model::ReadOptions;
use gs_model::ply::TimedModel;
use serde_json::json;
use start::Start;
use std::net::TcpListener;
use std::path::PathBuf;
use stream_maker::{EncodeArgs, StreamMaker};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx view scene.gsvx
  gsvx view clip.gsvx                        plays a sequence
  gsvx view scene.gsvx point_cloud.ply       side by side, with a line to move
  gsvx view city.gsvx --budget 500k          for a phone or an old machine
  gsvx view point_cloud.ply --encode         choose a quality by eye, and save the stream
  gsvx view point_cloud.ply --encode --cameras data/fox
  gsvx view scene.gsvx --port 8000 --no-open";

#[derive(clap::Args)]
pub(crate) struct ViewArgs {
    /// A stream, PLY, .glb, .splat or SPZ, and a second one to compare it with.
    #[arg(required = true, num_args = 1..=2)]
    files: Vec<PathBuf>,
    /// Most Gaussians to draw of a stream with levels of detail: near places are fine, distant ones coarse, and chunks
    /// are loaded as the camera moves: 500k, 2M [default: 2M].
    #[arg(long, value_name = "GAUSSIANS", value_parser = size::count)]
    budget: Option<u64>,
    #[command(flatten)]
    encoding: EncodeArgs,
    /// Port on this machine; 0 takes a free one.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Do not open the browser.
    #[arg(long)]
    no_open: bool,
}

/// Serves until it is interrupted.
pub(crate) fn run(args: &ViewArgs, report: Reporter) -> Result<()> {
    // A file that cannot be shown is told before the browser opens.
    for file in &args.files {
        input::open(file)?;
        ensure!(
            TimedModel::open(file, &ReadOptions::default())?.is_none(),
            "{}: Gaussians that move by formulas; make a sequence with gsvx encode --fps to view it",
            file.display()
        );
    }
    let listener = TcpListener::bind(("127.0.0.1", args.port)).map_err(|e| {
        anyhow!("port {}: cannot be opened: {e}; name another with --port", args.port)
    })?;
    let host = listener.local_addr().context("the server has no address")?.to_string();
    let maker = || StreamMaker::new(&args.encoding, &args.files, report);
    let maker = args.encoding.encode.then(maker).transpose()?;
    let start = Start::of(&args.files);
    let mut url = page(&host, args, start.as_ref());
    url += &maker.as_ref().map_or(String::new(), StreamMaker::query);
    let first = start.map_or(String::new(), |start| format!("first camera: {}\n", start.from));
    interrupt::is_the_end();
    report.say(false, &format!("{url}\n{first}Ctrl-C ends"), &json!({ "url": url }))?;
    if !args.no_open
        && let Err(error) = open::that_detached(&url)
    {
        note(format_args!("the browser does not open by itself ({error}): open the address above"));
    }
    let files = args.files.clone();
    server::serve(&listener, move |request| {
        let post = maker.as_ref().map(|maker| |path: &str, query: &str| maker.answer(path, query));
        let post = post.as_ref().map(|post| post as AnswerPost<'_>);
        answer::answer(request, &host, &files, post)
    });
    Ok(())
}

/// The address of the page with the files to show, and where it starts.
fn page(host: &str, ViewArgs { files, budget, .. }: &ViewArgs, start: Option<&Start>) -> String {
    let name = |i: usize| answer::place(i, &files[i]);
    let mut url = format!("http://{host}/?url={}", name(0));
    if files.len() > 1 {
        url += &format!("&compare={}", name(1));
    }
    if let Some(budget) = budget {
        url += &format!("&budget={budget}");
    }
    url + &start.map_or(String::new(), |start| start.query())
}
