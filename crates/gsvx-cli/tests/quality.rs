//! What an encode says about what is lost, and bounds on it.

mod common;

use common::{Folder, room};
use std::path::Path;

/// [`common::report`], with the paths behind the words.
fn report(line: &str, paths: &[&Path]) -> (serde_json::Value, String) {
    common::report(&(line.to_owned() + &" @".repeat(paths.len())), paths)
}

#[test]
fn the_estimated_loss_is_within_2_db_of_what_compare_measures() {
    let dir = Folder::new();
    let (room, stream) = (room(), dir.join("a.gsvx"));
    let model = room.join("point_cloud.ply");
    let score = |said: &serde_json::Value| said["psnr"].as_f64().unwrap();
    let third = |said: &serde_json::Value| said["ssimulacra2"].as_f64().unwrap();
    let mut before = 0.0;
    for quality in ["10", "50", "90"] {
        let words = format!("encode --force -q {quality} -o");
        let (said, error) = report(&words, &[&stream, &model]);
        let estimate = score(&said["estimated_loss"]);
        let (truth, _) = report("compare --orbit 8", &[&model, &stream]);
        let thirds = [third(&said["estimated_loss"]), third(&truth)];
        assert!((thirds[0] - thirds[1]).abs() < 6.0, "quality {quality}: {thirds:?}");
        let truth = score(&truth);
        assert!((estimate - truth).abs() < 2.0, "quality {quality}: {estimate}, in truth {truth}");
        assert!(estimate > before);
        before = estimate;
        assert_eq!(error.contains("the loss is easy to see"), quality == "10", "{error}");
        // With cameras it is measured there.
        let words = format!("encode --force -q {quality} --cameras @ @ -o @");
        let (said, _) = common::report(&words, &[&room, &model, &stream]);
        let estimate = score(&said["estimated_loss"]["at_cameras"]);
        // The figure that counts is the worse of this one and that around the model.
        let both = [estimate, score(&said["estimated_loss"]["around"])];
        assert_eq!(score(&said["estimated_loss"]), both[0].min(both[1]));
        assert_eq!(said["cameras_doubted"], false);
        let (truth, _) = report("compare --cameras", &[&room, &model, &stream]);
        let truth = score(&truth);
        assert!((estimate - truth).abs() < 2.0, "quality {quality}: {estimate}, in truth {truth}");
    }
    // A person reads what the number means.
    let said = common::ok("encode --force @ -o @", &[&model, &stream]);
    assert!(said.contains("estimated loss: about") && said.contains("see"), "{said}");
    let (said, _) = report("encode --force --lossless -o", &[&stream, &model]);
    assert!(said["estimated_loss"].is_null());
}

#[test]
fn bounds_on_errors_lie_between_the_best_quality_and_lossless() {
    let dir = Folder::new();
    let (model, stream) = (room().join("point_cloud.ply"), dir.join("a.gsvx"));
    let words = "encode --max-error 0.02,mean=0.05 -o";
    let (said, _) = report(words, &[&stream, &model]);
    assert_eq!(said["gaussians"], said["input_gaussians"]);
    for (name, bound) in [("mean", 0.05), ("opacity", 0.02), ("shape", 0.02), ("sh", 0.02)] {
        let error = said["max_error"][name].as_f64().unwrap();
        assert!(0.3 * bound < error && error <= bound, "{name}: {error}");
    }
    let (lossless, _) = report("encode --force --lossless -o", &[&stream, &model]);
    assert!(2 * said["bytes"].as_u64().unwrap() < lossless["bytes"].as_u64().unwrap());
    let both = "encode --max-error 0.01 --quality 60 @ -o @";
    common::wrong_usage(&common::run(both, &[&model, &stream]), "--quality");
    // What is there stays.
    let again = common::run(&format!("{words} @ @"), &[&stream, &model]);
    common::one_line(&again, "--force");
}

#[test]
fn pictures_that_show_nothing_give_no_figure() {
    let dir = Folder::new();
    let (model, stream) = (dir.join("clear.ply"), dir.join("a.gsvx"));
    let (mut scene, _) = gs_model::ply::read(room().join("point_cloud.ply")).unwrap();
    scene.opacity_logits.fill(-12.0);
    gs_model::ply::write(&model, &scene).unwrap();
    let said = common::ok("encode @ -o @", &[&model, &stream]);
    assert!(said.contains("no estimate of the loss: nothing of the model shows"), "{said}");
    let error = common::heard(&common::run("compare @ @ --orbit 2", &[&model, &stream]));
    assert!(error.contains("nothing of either model shows in any view"), "{error}");
}

#[test]
fn what_an_octree_cannot_tell_apart_has_a_warning() {
    let dir = Folder::new();
    let (model, stream) = (dir.join("pair.ply"), dir.join("a.gsvx"));
    let room = gs_model::ply::read(room().join("point_cloud.ply")).unwrap().0;
    let ball = testing::trained_like(1000, 0, &mut testing::Rng::seeded(5));
    let few = common::scene();
    let (apart, far) = ("parts of the scene lie so far apart", "Gaussians lie so far");
    let exact = "1000 of the stream's 2000 Gaussians lie so far from the others";
    let (double, together) =
        ("800 Gaussians share their position with another", "share their position");
    // A model twice, so far apart: what is said, and what is not.
    for (one, distance, flags, warned, silent) in [
        (&room, 1e3, " --no-estimate", "", apart),
        (&room, 1e5, " --no-estimate", apart, far),
        (&ball, 1e7, "", exact, together),
        (&few, 0.0, "", double, apart),
        (&few, 0.0, " --max-error 0.01", "", together),
    ] {
        let mut both = one.clone();
        both.append(one);
        both.means[one.len()..].iter_mut().for_each(|p| p[0] += distance);
        gs_model::ply::write(&model, &both).unwrap();
        let (said, error) = report(&format!("encode --force{flags} -o"), &[&stream, &model]);
        assert!(error.contains(warned) && !error.contains(silent), "{distance}: {error}");
        if warned == exact {
            assert_eq!(said["outliers"], 1000);
            assert!(error.contains("% of the bytes; encode each part apart"), "{error}");
        }
    }
}

#[test]
fn one_gaussian_is_told_in_the_singular() {
    let dir = Folder::new();
    let (model, stream) = (dir.join("one.ply"), dir.join("a.gsvx"));
    let mut scene = testing::trained_like(1, 0, &mut testing::Rng::seeded(5));
    gs_model::ply::write(&model, &scene).unwrap();
    let encode = || common::run("encode @ --force -o @", &[&model, &stream]);
    let said = common::said(&encode());
    assert!(said.contains("1 Gaussian coded as 1"), "{said}");
    // A model of one Gaussian has no extent, and still shows in pictures.
    assert!(said.contains("estimated loss"), "{said}");
    let info = common::ok("info @", &[&stream]);
    assert!(info.contains("side 1.1755e-38"), "{info}");
    scene.append(&testing::trained_like(2, 0, &mut testing::Rng::seeded(6)));
    scene.means[1][0] = f32::NAN;
    gs_model::ply::write(&model, &scene).unwrap();
    common::one_line(&encode(), "(1 invalid Gaussian in all); pass --drop-invalid");
}
