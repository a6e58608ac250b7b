//! `cargo xtask web`: the decoder as WebAssembly, the npm package around it, and the viewer page.
//!
//! The package is `crates/gsvx-web/npm`; what is built goes to its folder `wasm`. The page, one file with
//! engine and decoder in it, goes to `crates/gsvx-cli/view`, from where the command `gsvx view` takes it.

use anyhow::Result;
use eval::scenes::DEFAULT;

use crate::demo;
use crate::needs::{self, CHROMIUM};
use crate::npm::{needed, package, page, script};

/// Arguments of `web`.
#[derive(clap::Args, Debug)]
pub(crate) struct WebArgs {
    /// Make the viewer page too.
    #[arg(long)]
    page: bool,
    /// Test the packed package in Node, and the adapters and the pages in Chromium.
    #[arg(long)]
    test: bool,
    /// Measure in Chromium and write docs/results/web.md.
    #[arg(long)]
    bench: bool,
}

/// Builds, and does what else is asked for.
pub(crate) fn run(args: &WebArgs) -> Result<()> {
    needed()?;
    if args.bench {
        CHROMIUM.get()?;
    } else if args.test
        && let Err(lacking) = CHROMIUM.get()
    {
        eprintln!("SKIPPED: all tests in a browser: {lacking}");
    }
    let tarball = package()?;
    println!("{}: {} bytes", tarball.display(), tarball.metadata()?.len());
    if args.page {
        page("viewer/build.mjs", &[])?;
    }
    if args.test || args.bench {
        let mut tools = vec![("GSVX_BIN", eval::gsvx_command()?)];
        tools.extend(needs::chromium().map(|path| ("CHROMIUM", path)));
        if args.test {
            if needs::chromium().is_some() {
                let demo = eval::scenes::root().join("out/web/demo");
                demo::make(DEFAULT, &demo)?;
                tools.push(("GSVX_DEMO", demo));
            }
            script("test/run.mjs", &[&tarball], &tools)?;
        }
        if args.bench {
            script("bench/run.mjs", &[], &tools)?;
        }
    }
    Ok(())
}
