//! Models whose columns differ from the Inria layout.

mod common;

use common::says;
use gs_model::{Report, Result, Scene, ply};

/// A PLY of floats with these columns and rows.
fn ply_of(columns: &str, rows: &[&[f32]]) -> Result<(Scene, Report)> {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for column in columns.split_whitespace() {
        let kind = if ["red", "green", "blue"].contains(&column) { "uchar" } else { "float" };
        text += &format!("property {kind} {column}\n");
    }
    text += "end_header\n";
    for row in rows {
        text += &row.iter().map(|v| format!("{v} ")).collect::<String>();
        text += "\n";
    }
    ply::read_bytes(text.as_bytes())
}

#[test]
fn discs_of_2d_gaussian_splatting_get_a_thickness() {
    let columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let row = [1., 2., 3., 0.1, 0.2, 0.3, 0.5, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0];
    let (scene, report) = ply_of(columns, &[&row]).unwrap();
    assert_eq!(scene.log_scales[0][..2], [-2.0, -3.0]);
    assert!((scene.log_scales[0][2] + 3.0 + libm::logf(1000.0)).abs() < 1e-6);
    assert!(report.notes[0].contains("2D Gaussian splatting"), "{:?}", report.notes);
}

#[test]
fn colours_as_bytes_are_sh_coefficients() {
    let columns = "x y z red green blue opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let row = [1., 2., 3., 255.0, 0.0, 51.0, 0.5, -2.0, -3.0, -4.0, 1.0, 0.0, 0.0, 0.0];
    let (scene, report) = ply_of(columns, &[&row]).unwrap();
    let colour = scene.sh_of(0)[0].map(|v| 0.5 + gs_model::SH_C0 * v);
    for (c, expected) in colour.into_iter().zip([1.0, 0.0, 0.2]) {
        assert!((c - expected).abs() < 1e-6, "{colour:?}");
    }
    assert!(report.notes.len() == 1, "{:?}", report.notes);
    // Points without scales are no model.
    says(ply_of("x y z red green blue", &[&[0.0; 6]]), "a plain point cloud");
}

#[test]
fn filter_3d_of_mip_splatting_is_added() {
    let columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
                   filter_3D";
    let row =
        |f: f32, l: f32| [1., 2., 3., 0.1, 0.2, 0.3, l, -2.0, -3.0, -4.0, 1.0, 0.0, 0.0, 0.0, f];
    let (scene, report) = ply_of(columns, &[&row(0.05, 1.0), &row(0.0, 1.0)]).unwrap();
    // Mip-Splatting's own formulas, in floating point of twice the width.
    let variances = [-2.0f64, -3.0, -4.0].map(|s| libm::exp(2.0 * s));
    let smoothed = variances.map(|v| v + 0.0025);
    let factor = (variances.iter().product::<f64>() / smoothed.iter().product::<f64>()).sqrt();
    let opacity = factor / (1.0 + libm::exp(-1.0));
    for (s, v) in scene.log_scales[0].into_iter().zip(smoothed) {
        assert!((f64::from(s) - 0.5 * libm::log(v)).abs() < 1e-6);
    }
    let logit = libm::log(opacity / (1.0 - opacity));
    assert!((f64::from(scene.opacity_logits[0]) - logit).abs() < 1e-5);
    // Without smoothing, every bit stays.
    assert_eq!((scene.log_scales[1], scene.opacity_logits[1]), ([-2.0, -3.0, -4.0], 1.0));
    assert!(report.notes.len() == 1, "{:?}", report.notes);
}
