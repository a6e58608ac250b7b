//! Models that move by formulas: SpaceTime Gaussians and FreeTimeGS.
#![allow(missing_docs, reason = "a test")]

use gs_model::ply::TimedModel;
use gs_model::{Invalid, ReadOptions, SH_C0, ply};
use std::path::PathBuf;
use testing::{Rng, SPACETIME, float_ply};

const FREETIME: &str = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
    time log_duration velocity_0 velocity_1 velocity_2";

fn rows(columns: &str, count: usize) -> Vec<Vec<f32>> {
    let mut rng = Rng::seeded(4);
    let width = columns.split_whitespace().count();
    (0..count).map(|_| (0..width).map(|_| rng.signed()).collect()).collect()
}

struct File(tempfile::TempDir);

impl File {
    fn of(bytes: &[u8]) -> Self {
        let file = Self(tempfile::tempdir().unwrap());
        std::fs::write(file.path(), bytes).unwrap();
        file
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("a.ply")
    }

    fn open(&self) -> TimedModel {
        TimedModel::open(self.path(), &ReadOptions::default()).unwrap().unwrap()
    }

    fn error(&self) -> String {
        TimedModel::open(self.path(), &ReadOptions::default()).unwrap_err().to_string()
    }
}

fn near(a: f32, b: f32) {
    assert!((a - b).abs() <= 1e-4 * (1.0 + b.abs()), "{a}, not {b}");
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + libm::expf(-x))
}

#[test]
fn spacetime_gaussians_are_where_their_formulas_say() {
    let rows = rows(SPACETIME, 50);
    let model = File::of(&float_ply("", SPACETIME, &rows)).open();
    assert_eq!(model.frames, None);
    for (number, t) in [(0, 0.0), (3, 0.3f32), (9, 0.9)] {
        let (scene, there) = model.frame(number, 10);
        for (i, row) in rows.iter().enumerate() {
            let d = t - row[3];
            for k in 0..3 {
                let moved = row[8 + k] * d + row[11 + k] * d * d + row[14 + k] * d * d * d;
                near(scene.means[i][k], row[k] + moved);
                near(0.5 + SH_C0 * scene.sh[i][k], row[17 + k]);
            }
            (0..4).for_each(|k| near(scene.rotations[i][k], row[24 + k] + row[28 + k] * d));
            let widths = d / libm::expf(row[4]);
            let alpha = sigmoid(row[20]) * libm::expf(-widths * widths);
            near(sigmoid(scene.opacity_logits[i]), alpha);
            assert_eq!(there[i], alpha >= 1.0 / 255.0);
        }
        assert_eq!((scene.len(), scene.sh_degree), (50, 0));
    }
}

#[test]
fn free_time_gaussians_are_where_their_formulas_say() {
    let rows = rows(FREETIME, 50);
    let comments = "comment ftgs_version 1\ncomment min_duration 0.5\ncomment n_frames 11\n";
    let model = File::of(&float_ply(comments, FREETIME, &rows)).open();
    assert_eq!(model.frames, Some(11));
    let (scene, there) = model.frame(4, 11);
    for (i, row) in rows.iter().enumerate() {
        let d = 0.4 - row[17];
        (0..3).for_each(|k| near(scene.means[i][k], row[k] + row[19 + k] * d));
        let widths = d / libm::expf(row[18]).max(0.5);
        let alpha = sigmoid(row[9]) * libm::expf(-0.5 * widths * widths);
        near(sigmoid(scene.opacity_logits[i]), alpha);
        assert_eq!(there[i], alpha >= 1.0 / 255.0);
        assert_eq!(scene.sh[i], [row[6], row[7], row[8]]);
    }
}

#[test]
fn what_is_wrong_is_named() {
    let good = rows(SPACETIME, 3);
    let with = |column: usize, value: f32| {
        let mut rows = good.clone();
        rows[1][column] = value;
        File::of(&float_ply("", SPACETIME, &rows))
    };
    for (column, value, said) in [
        (4, -200.0, "Gaussian 1: its window in time has no length"),
        (4, f32::NEG_INFINITY, "Gaussian 1: its window in time has no length"),
        (3, f32::NAN, "not finite"),
        (8, f32::INFINITY, "not finite"),
        (0, f32::NAN, "Gaussian 1: mean"),
    ] {
        let file = with(column, value);
        assert!(file.error().contains(said), "{}", file.error());
        let options = ReadOptions { invalid: Invalid::Drop, ..ReadOptions::default() };
        let model = TimedModel::open(file.path(), &options).unwrap().unwrap();
        assert_eq!(model.frame(0, 2).1.len(), 2);
    }
    let renamed = |from: &str, to: &str| {
        File::of(&float_ply("", &SPACETIME.replace(from, to), &good)).error()
    };
    assert!(renamed("motion_7", "other").contains("no property motion_7"));
    assert!(renamed("rot_2", "other").contains("no property rot_2"));
    assert!(renamed("nx", "f_t_0").contains("neural network"));
    let bytes = float_ply("comment min_duration 0\n", FREETIME, &rows(FREETIME, 3));
    assert!(File::of(&bytes).error().contains("min_duration 0"));
    let still = File::of(&float_ply("", SPACETIME, &good));
    let error = ply::read(still.path()).unwrap_err().to_string();
    assert!(error.contains("gsvx encode --fps makes a sequence of it"), "{error}");
    let cut = float_ply("", SPACETIME, &good);
    assert!(File::of(&cut[..cut.len() - 1]).error().contains("row 2 is not whole"));
    let plain = File::of(&float_ply("", "x y z", &[vec![0.0; 3]]));
    assert!(TimedModel::open(plain.path(), &ReadOptions::default()).unwrap().is_none());
}
