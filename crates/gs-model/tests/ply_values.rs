//! Numbers: writing then reading is the identity on bits, and invalid ones are found.

mod common;

use common::ply::{ENCODINGS, File, ascii_ply};
use common::{DROP, KEEP, bits, says, scene, written};
use gs_model::scene::Field;
use gs_model::{CLAMPED_OPACITY_LOGIT, Error, Scene, model, ply};
use proptest::collection::vec;
use proptest::prelude::*;

/// Any finite number: zeros of both signs, subnormals, the largest.
fn finite() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(|bits| {
        let value = f32::from_bits(bits);
        // An exponent of all ones (NaN, infinity) becomes that of subnormals.
        if value.is_finite() { value } else { f32::from_bits(bits & 0x807f_ffff) }
    })
}

fn triple() -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(finite())
}

/// Log-scales. What is lower than any logarithm stands for a scale of 0, which is not kept.
fn log_scales() -> impl Strategy<Value = [f32; 3]> {
    triple().prop_map(|scales| scales.map(|s| if s < -1e6 { -s } else { s }))
}

/// Any quaternion whose norm is far from both ends, with any small components.
fn quaternion() -> impl Strategy<Value = [f32; 4]> {
    (0..4usize, 1e-15f32..1e15, any::<bool>(), prop::array::uniform4(finite())).prop_map(
        |(largest, size, negative, mut q)| {
            for v in &mut q {
                if v.abs() > 1e15 {
                    *v = 1.0 / *v;
                }
            }
            q[largest] = if negative { -size } else { size };
            q
        },
    )
}

fn any_scene() -> impl Strategy<Value = Scene> {
    (0..40usize, 0..4u8).prop_flat_map(|(n, sh_degree)| {
        let k = usize::from(sh_degree + 1) * usize::from(sh_degree + 1);
        (
            vec(triple(), n),
            vec(quaternion(), n),
            vec(log_scales(), n),
            vec(finite(), n),
            vec(triple(), n * k),
        )
            .prop_map(move |(means, rotations, log_scales, opacity_logits, sh)| Scene {
                means,
                rotations,
                log_scales,
                opacity_logits,
                sh_degree,
                sh,
                ..Scene::default()
            })
    })
}

proptest! {
    #[test]
    fn writing_then_reading_is_the_identity(scene in any_scene()) {
        prop_assert!(scene.validate().is_ok());
        // Text of the shortest form that parses back; -0 and subnormals included.
        let all = ENCODINGS.map(|format| File::inria(format, scene.sh_degree).bytes(&scene).0);
        for file in all.into_iter().chain([written("ply", &scene)]) {
            let (back, report) = ply::read_bytes(&file).unwrap();
            prop_assert_eq!(bits(&back), bits(&scene));
            prop_assert_eq!(back.sh_degree, scene.sh_degree);
            prop_assert_eq!(report.gaussians_in_file, scene.len());
        }
    }

    #[test]
    fn any_bytes_at_all_never_panic(
        head in prop::sample::select(vec!["", "ply\n", "ply\nformat ascii 1.0\nelement vertex 2\n"]),
        body in vec(any::<u8>(), 0..300),
    ) {
        let mut bytes = head.as_bytes().to_vec();
        bytes.extend(body);
        prop_assert!(ply::read_bytes(&bytes).is_err());
    }
}

/// Every number of Gaussian `i`, with its field.
fn numbers(scene: &mut Scene, i: usize) -> Vec<(Field, &mut f32)> {
    let k = scene.sh_len();
    let mut all = Vec::new();
    all.extend(scene.means[i].iter_mut().map(|v| (Field::Mean, v)));
    all.extend(scene.rotations[i].iter_mut().map(|v| (Field::Rotation, v)));
    all.extend(scene.log_scales[i].iter_mut().map(|v| (Field::LogScale, v)));
    all.push((Field::OpacityLogit, &mut scene.opacity_logits[i]));
    let sh = scene.sh[i * k..(i + 1) * k].as_flattened_mut();
    all.extend(sh.iter_mut().map(|v| (Field::Sh, v)));
    all
}

#[test]
fn every_bad_number_is_found_wherever_it_is() {
    let good = scene(5, 1);
    let per_gaussian = numbers(&mut good.clone(), 0).len();
    for number in 0..per_gaussian {
        let field = numbers(&mut good.clone(), 0)[number].0;
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            // Opacities of 0 and 1, and a scale of 0, are valid.
            let valid = match field {
                Field::OpacityLogit => bad.is_infinite(),
                Field::LogScale => bad == f32::NEG_INFINITY,
                _ => false,
            };
            if valid {
                continue;
            }
            let mut scene = good.clone();
            let field = {
                let mut all = numbers(&mut scene, 3);
                *all[number].1 = bad;
                all[number].0
            };
            let bytes = written("ply", &scene);
            match ply::read_bytes(&bytes) {
                Err(Error::InvalidGaussian { index: 3, field: found, value, count: 1, .. }) => {
                    assert_eq!(found, field);
                    assert_eq!(value.to_bits(), bad.to_bits());
                }
                other => panic!("{number}: {other:?}"),
            }
            let (kept, report) = model::read_named("a.ply", &bytes, &DROP).unwrap();
            assert_eq!(kept, good.select(&[0, 1, 2, 4]));
            assert_eq!((report.gaussians_in_file, report.dropped), (5, 1));
        }
    }
}

#[test]
fn quaternions_without_direction_are_found() {
    let good = scene(4, 0);
    for q in [[0.0; 4], [-0.0, 0.0, -0.0, 0.0], [1e-25, 0.0, 0.0, 1e-30], [1e20, 0.0, 0.0, 1.0]] {
        let mut scene = good.clone();
        scene.rotations[1] = q;
        match scene.validate() {
            Err(Error::InvalidGaussian { index: 1, field: Field::Rotation, .. }) => {}
            other => panic!("{q:?}: {other:?}"),
        }
        assert_eq!(scene.drop_invalid(), 1);
        assert_eq!(scene, good.select(&[0, 2, 3]));
    }
    let mut scene = good;
    scene.rotations[1] = [1e-15, 0.0, 0.0, 0.0];
    assert!(scene.validate().is_ok());
    assert_eq!(scene.drop_invalid(), 0);
}

#[test]
fn invalid_gaussians_are_counted_once() {
    // Many, in every task of the parallel search.
    let mut scene = scene(50_000, 0);
    (scene.log_scales, scene.sh) = (vec![[-3.0; 3]; 50_000], vec![[0.5; 3]; 50_000]);
    for i in (0..50_000).step_by(10) {
        scene.means[i][1] = f32::NAN;
        scene.sh[i][2] = f32::INFINITY;
    }
    scene.rotations[7] = [0.0; 4];
    let found = scene.invalid().unwrap();
    assert_eq!((found.count, found.index, found.field), (5001, 0, Field::Mean));
    let message = scene.validate().unwrap_err().to_string();
    assert!(message.contains("Gaussian 0: mean is NaN (5001 invalid"), "{message}");
    assert_eq!(scene.drop_invalid(), 5001);
    assert_eq!(scene.len(), 44_999);
    assert!(scene.validate().is_ok());
}

#[test]
fn infinite_opacities_are_read_as_the_largest_and_the_smallest() {
    let mut scene = scene(4, 0);
    scene.opacity_logits[1] = f32::INFINITY;
    scene.opacity_logits[2] = f32::NEG_INFINITY;
    scene.opacity_logits[3] = 1e38;
    let (back, report) = ply::read_bytes(&written("ply", &scene)).unwrap();
    let clamped = [CLAMPED_OPACITY_LOGIT, -CLAMPED_OPACITY_LOGIT, 1e38];
    assert_eq!(back.opacity_logits[1..], clamped);
    assert_eq!(back.opacity_logits[0], scene.opacity_logits[0]);
    let said = [
        "1 opacity is infinite; read as the largest",
        "1 opacity is minus infinity; read as the smallest",
    ];
    assert_eq!(report.notes, said);
    // Whoever leaves out invalid Gaussians keeps these.
    let (kept, report) = model::read_named("a.ply", &written("ply", &scene), &DROP).unwrap();
    assert_eq!((kept, report.dropped), (back, 0));
    // No tool writes NaN for an opacity on purpose.
    scene.opacity_logits[1] = f32::NAN;
    assert!(ply::read_bytes(&written("ply", &scene)).is_err());
}

#[test]
fn a_scale_of_0_is_read_as_a_thin_disc() {
    let mut scene = scene(4, 0);
    let zero = f32::NEG_INFINITY;
    scene.log_scales =
        vec![[-1.0, -2.0, zero], [zero, -3.0, -1e38], [zero; 3], [-1.0, -2.0, -90.0]];
    let (back, report) = ply::read_bytes(&written("ply", &scene)).unwrap();
    let thin = |least: f32| least - libm::logf(1000.0);
    let expected = [[-1.0, -2.0, thin(-2.0)], [thin(-3.0), -3.0, thin(-3.0)]];
    assert_eq!(back.log_scales[..2], expected);
    assert!(back.log_scales[2].iter().all(|&s| libm::expf(s) >= 1e-38));
    assert_eq!(back.log_scales[3], scene.log_scales[3]);
    assert!(report.notes[0].starts_with("2 Gaussians have a scale of 0"), "{:?}", report.notes);
    assert!(report.notes[1].starts_with("1 Gaussian has three scales of 0"), "{:?}", report.notes);
    // An infinite scale means nothing.
    scene.log_scales[3][0] = f32::INFINITY;
    says(ply::read_bytes(&written("ply", &scene)), "Gaussian 3: log-scale is inf (1 invalid");
}

#[test]
fn a_rotation_of_any_length_is_one_and_only_zeros_are_none() {
    let mut scene = scene(5, 0);
    scene.rotations[1] = [0.0, 0.0, -3e30, 0.0];
    scene.rotations[2] = [0.0, f32::MAX, f32::MAX, 0.0];
    scene.rotations[3] = [0.0, 0.0, 0.0, -1e-42];
    scene.rotations[4] = [3e15, 0.0, 4e15, 0.0];
    let (back, report) = ply::read_bytes(&written("ply", &scene)).unwrap();
    assert_eq!(back.rotations[..1], scene.rotations[..1]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let expected = [[0.0, 0.0, -1.0, 0.0], [0.0, half, half, 0.0], [0.0, 0.0, 0.0, -1.0]];
    assert_eq!(back.rotations[1..4], expected);
    // Floats hold its square.
    assert_eq!(back.rotations[4], scene.rotations[4]);
    let said = "3 rotations are quaternions of extreme length; read as those of length 1";
    assert_eq!(report.notes, [said]);
    assert_eq!(model::read_named("a.ply", &written("ply", &scene), &KEEP).unwrap().0, scene);
    scene.rotations[2] = [0.0; 4];
    says(ply::read_bytes(&written("ply", &scene)), "Gaussian 2: rotation is of no length");
}

#[test]
fn points_do_not_make_the_steps_of_positions_coarse() {
    let mut scene = scene(20, 0);
    scene.log_scales[..8].fill([f32::NEG_INFINITY; 3]);
    let (_, report) = ply::read_bytes(&written("ply", &scene)).unwrap();
    assert_eq!(report.warnings, [""; 0]);
}

#[test]
fn values_that_no_model_has_are_left_out_with_the_invalid_ones() {
    let mut scene = scene(5, 1);
    scene.log_scales[1][2] = 1e38;
    scene.sh[3 * 4][0] = -1e6;
    // They are numbers, which lossless coding keeps.
    assert_eq!(ply::read_bytes(&written("ply", &scene)).unwrap().0, scene);
    let (kept, report) = model::read_named("a.ply", &written("ply", &scene), &DROP).unwrap();
    assert_eq!((kept, report.dropped), (scene.select(&[0, 2, 4]), 2));
}

#[test]
fn every_value_can_be_kept_as_it_is() {
    let mut scene = scene(5, 0);
    scene.opacity_logits[0] = f32::INFINITY;
    scene.log_scales[1] = [f32::NEG_INFINITY; 3];
    scene.rotations[2] = [0.0; 4];
    let (kept, report) = model::read_named("a.ply", &written("ply", &scene), &KEEP).unwrap();
    assert_eq!((kept, report.dropped), (scene, 0));
    assert!(report.notes[0].starts_with("3 Gaussians have values that are not finite"));
}

#[test]
fn of_sh_degree_4_the_lower_degrees_are_read() {
    // f_rest is channel-major: 24 of red, then of green, then of blue.
    let rest: String = (0..72).map(|k| format!(" f_rest_{k}")).collect();
    let columns =
        "x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2";
    let file = |rest_of: &dyn Fn(usize) -> f32| {
        let row: Vec<f32> = [0.5; 14].into_iter().chain((0..72).map(rest_of)).collect();
        ascii_ply(&format!("{columns}{rest}"), &[&row])
    };
    let (scene, report) = ply::read_bytes(&file(&|k| k as f32)).unwrap();
    assert_eq!(scene.sh_degree, 3);
    for k in 1..16 {
        assert_eq!(scene.sh_of(0)[k], [0.0, 24.0, 48.0].map(|first| first + (k - 1) as f32));
    }
    assert_eq!(report.notes, ["SH coefficients of degree 4 are not kept; degrees 0 to 3 are read"]);
    // Coefficients that are all zero are no loss.
    assert!(ply::read_bytes(&file(&|_| 0.0)).unwrap().1.notes.is_empty());
}

#[test]
fn arrays_that_do_not_fit_together_are_refused() {
    let good = scene(3, 1);
    type Breakage = (Field, fn(&mut Scene));
    let breakages: [Breakage; 4] = [
        (Field::Rotation, |s| s.rotations.truncate(2)),
        (Field::LogScale, |s| s.log_scales.push([0.0; 3])),
        (Field::OpacityLogit, |s| s.opacity_logits.clear()),
        (Field::Sh, |s| s.sh.truncate(11)),
    ];
    for (expected, breakage) in breakages {
        let mut scene = good.clone();
        breakage(&mut scene);
        match (scene.validate(), ply::write_to(Vec::new(), &scene)) {
            (Err(Error::SceneShape { field, .. }), Err(Error::SceneShape { .. })) => {
                assert_eq!(field, expected);
            }
            other => panic!("{other:?}"),
        }
        scene.drop_invalid();
        assert!(scene.validate().is_ok());
    }
    let scene = Scene { sh_degree: 4, ..Scene::default() };
    assert!(matches!(scene.validate(), Err(Error::SceneDegree { degree: 4 })));
}

#[test]
fn a_file_appears_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.ply");
    let scene = scene(3, 1);
    ply::write(&path, &scene).unwrap();
    assert_eq!(ply::read(&path).unwrap().0, scene);
    // Over an existing file, and refused: the old one stays.
    let smaller = scene.select(&[0]);
    ply::write(&path, &smaller).unwrap();
    let broken = Scene { rotations: Vec::new(), ..scene.clone() };
    assert!(ply::write(&path, &broken).is_err());
    assert_eq!(ply::read(&path).unwrap().0, smaller);
    // A folder in the way: the rename fails, and no temporary file stays.
    let folder = dir.path().join("folder.ply");
    std::fs::create_dir(&folder).unwrap();
    let outcome = ply::write(&folder, &scene);
    assert!(matches!(outcome, Err(Error::Io { action: "rename", .. })), "{outcome:?}");
    let outcome = ply::write(dir.path().join("missing/model.ply"), &scene);
    assert!(matches!(outcome, Err(Error::Io { action: "create", .. })), "{outcome:?}");
    let mut left: Vec<_> =
        std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["folder.ply", "model.ply"]);
}
