//! `cargo xtask stability`: runs the tests that compare the rasterizer with its f64 oracle, and writes what
//! they print as a page.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use eval::cells;
use eval::page::{Page, Table};

/// Flags of `cargo xtask stability`.
#[derive(clap::Args, Debug)]
pub(crate) struct StabilityArgs {
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/stability.md")]
    out: PathBuf,
}

pub(crate) fn run(args: &StabilityArgs) -> Result<()> {
    let words =
        "test --quiet -p finetune --test stability --test oracle -- --nocapture --test-threads 1";
    let tests = Command::new("cargo")
        .args(words.split(' '))
        .current_dir(eval::scenes::root())
        .output()
        .context("start cargo")?;
    let error = String::from_utf8_lossy(&tests.stderr);
    ensure!(tests.status.success(), "cargo {words}: {}", error.lines().last().unwrap_or_default());
    let mut page = Page::new(&args.out, "Is the rasterizer stable?");
    // A dot for each test may stand before what the next one prints.
    let printed = String::from_utf8_lossy(&tests.stdout);
    let lines: Vec<&str> = printed.lines().map(|l| l.trim_start_matches('.')).collect();
    write(&mut page, &lines.join("\n"));
    page.write()
}

/// The page of what the tests printed: rows of a table, and `input: ... from the oracle` or
/// `... worst relative error ...`.
fn write(page: &mut Page, printed: &str) {
    page.text(
        "`cargo xtask stability` runs the tests `stability` and `oracle` of finetune. The oracle is a renderer in f64 \
         without tiles: covariance and conic as in the textbook, every Gaussian against every pixel. A pixel is \
         doubtful, and not counted, if in f64 some alpha is within 1e-3 of the cut at 1/255 or some transmittance \
         within 1 % of the stop: there f32 may decide otherwise, and both images are right. All images, losses and \
         gradients must be finite.",
    );
    let rows: Vec<&str> = printed.lines().filter(|l| l.starts_with('|')).collect();
    page.text(rows.join("\n"));
    page.table(&figures(printed));
    page.text(
        "The tests also render cameras with zero, negative, infinite and NaN parameters, images without pixels, 100,000 \
         layers in a pixel, and random bit patterns, and demand finite output. How the rasterizer avoids cancellation: \
         [finetune](../../crates/finetune/README.md#method).",
    );
}

fn figures(printed: &str) -> Table {
    let mut table = Table::new("input | result");
    for (input, says) in printed.lines().filter_map(|line| line.split_once(": ")) {
        if says.ends_with("from the oracle") || says.contains("relative error") {
            table.row(cells![input, says.split(',').next().unwrap_or(says)]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::figures;

    #[test]
    fn figures_are_told_from_the_rest() {
        let printed = "\nrunning 2 tests\n| a | 1 |\n16x16: 1e-6 from the oracle\nok: as it was\n";
        let rows = figures(printed);
        assert_eq!(format!("{rows:?}").matches("16x16").count(), 1);
        assert!(!format!("{rows:?}").contains("as it was"));
    }
}
