//! A greater quality does not look worse.

use anyhow::{Result, ensure};
use eval::bench::{ALLOWED_DB, Sweep, all_qualities};
use eval::scenes;

use super::{Tally, Verdict};

pub(super) fn checks(tally: &mut Tally) {
    tally.check("a greater quality looks no worse", sweep);
}

/// The room with cameras, at qualities from 5 to 100 in steps of 1.
fn sweep() -> Result<Verdict> {
    let drop = Sweep::of(scenes::DEFAULT, &all_qualities(1))?.of_mean();
    let says = format!("quality {} lies {:.2} dB below {}", drop.to, drop.db, drop.from);
    ensure!(drop.db <= ALLOWED_DB, "{says}; {ALLOWED_DB} dB is allowed");
    Ok(Verdict::Holds(format!(
        "at most {:.2} dB of PSNR are lost from one quality to a greater one",
        drop.db
    )))
}
