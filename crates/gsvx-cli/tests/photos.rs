//! `gsvx tune`, with photos as people have them.

mod common;

use common::{Folder, heard, model, one_line, room, room_cameras, run, said};
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A scene with cameras and photos of the room: its model, and the photos as `put` writes them.
struct Scene {
    dir: Folder,
}

impl Scene {
    fn new(put: impl Fn(&Path, &str, image::RgbImage)) -> Self {
        let dir = Folder::new();
        room_cameras(&dir, "");
        for file in common::names(&room().join("images")) {
            let photo = image::open(room().join("images").join(&file)).unwrap().into_rgb8();
            // Small photos are quick.
            let photo = image::imageops::resize(&photo, 120, 80, image::imageops::Triangle);
            put(&dir, file.strip_suffix(".png").unwrap(), photo);
        }
        Self { dir }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// A short tune.
    fn tune(&self, words: &str) -> Output {
        let line = "tune @ --cameras @ -o @ --effort quick --json --force --quality 30";
        run(&format!("{line}{words}"), &[&model(), &self.dir, &self.path("a.gsvx")])
    }

    /// Whether a tune had renders as its targets, the PSNR of the input model, and what was said.
    #[track_caller]
    fn tuned(&self) -> (bool, f64, String) {
        let out = self.tune("");
        let json: serde_json::Value = serde_json::from_str(&said(&out)).unwrap();
        let psnr = json["input_psnr"].as_f64().unwrap_or_default();
        (json["distilled"].as_bool().unwrap(), psnr, heard(&out))
    }
}

fn save(file: PathBuf, photo: impl Into<image::DynamicImage>) {
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    photo.into().save(file).unwrap();
}

#[test]
fn photos_are_found_by_stem_in_folders_of_smaller_sizes() {
    let scene = Scene::new(|dir, stem, photo| {
        let name = format!("images_2/{}.WebP", stem.to_uppercase());
        save(dir.join(name), photo);
    });
    let (distilled, psnr, said) = scene.tuned();
    assert!(!distilled && psnr > 25.0, "{psnr} {said}");
    // Photos of other names.
    let scene = Scene::new(|dir, stem, photo| save(dir.join(format!("images/x{stem}.jpg")), photo));
    let out = scene.tune("");
    one_line(&out, "looked for");
    let error = heard(&out);
    assert!(error.contains("xview_000.jpg") && error.contains("--distil"), "{error}");
    assert!(error.contains("images/view_001.png"), "{error}");
    // No photos at all.
    fs::remove_dir_all(scene.path("images")).unwrap();
    let (distilled, _, said) = scene.tuned();
    let first = said.lines().next().unwrap();
    assert!(distilled && first.starts_with("warning: ") && first.contains("no photos"), "{said}");
}

#[test]
fn a_tenth_of_the_photos_may_be_missing_or_broken() {
    let scene = Scene::new(|dir, stem, photo| save(dir.join(format!("images/{stem}.png")), photo));
    fs::remove_file(scene.path("images/view_003.png")).unwrap();
    fs::write(scene.path("images/view_005.png"), "no photo").unwrap();
    let (distilled, _, said) = scene.tuned();
    let line = said.lines().find(|l| l.contains("left out")).unwrap();
    assert!(!distilled && line.contains("view_003.png, view_005.png"), "{said}");
    fs::write(scene.path("images/view_006.png"), "no photo").unwrap();
    one_line(&scene.tune(""), "view_003.png, view_005.png, view_006.png");
    for i in 9..14 {
        fs::remove_file(scene.path(&format!("images/view_{i:03}.png"))).unwrap();
    }
    one_line(&scene.tune(""), "not found");
}

#[test]
fn transparent_pixels_are_black() {
    let scene = Scene::new(|dir, stem, photo| {
        let mut photo = image::DynamicImage::from(photo).into_rgba8();
        // What is transparent has a colour of its own, which does not show.
        for pixel in photo.pixels_mut().filter(|p| p.0[..3].iter().all(|&v| v < 40)) {
            pixel.0 = [255, 255, 255, 0];
        }
        save(dir.join(format!("images/{stem}.png")), photo);
    });
    let (distilled, psnr, said) = scene.tuned();
    assert!(!distilled && psnr > 20.0, "{psnr} {said}");
    assert!(said.contains("photos have transparent pixels, which are black"), "{said}");
}

#[test]
fn photos_are_undistorted_and_turned_as_their_exif_data_say() {
    let scene = Scene::new(|dir, stem, photo| save(dir.join(format!("images/{stem}.png")), photo));
    let (_, straight, _) = scene.tuned();
    // Each pixel of a photo through a lens shows what its neighbourhood, found by a search, shows without.
    let k1 = 0.1;
    let scene = Scene::new(|dir, stem, photo| {
        let focal = 97.5_f64;
        let bent = image::RgbImage::from_fn(120, 80, |x, y| {
            let [x, y] = [f64::from(x) + 0.5 - 60.0, f64::from(y) + 0.5 - 40.0];
            let mut factor = 1.0;
            for _ in 0..50 {
                let r = factor * x.hypot(y) / focal;
                factor = 1.0 / (1.0 + k1 * r * r);
            }
            let [x, y] = [factor * x + 59.5, factor * y + 39.5].map(|v| v as f32);
            let shown = image::imageops::interpolate_bilinear(&photo, x, y);
            shown.unwrap_or(image::Rgb([0; 3]))
        });
        save(dir.join(format!("images/{stem}.png")), bent);
    });
    let (_, ignored, _) = scene.tuned();
    room_cameras(&scene.dir, &format!(" {k1} 0 0 0"));
    let (_, undone, said) = scene.tuned();
    assert!(
        undone > straight - 1.0 && ignored < straight - 2.0,
        "{straight} {ignored} {undone} {said}"
    );
    let scene = Scene::new(|dir, stem, photo| {
        let file = dir.join(format!("images/{stem}.jpg"));
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        let mut encoder = JpegEncoder::new_with_quality(fs::File::create(file).unwrap(), 95);
        // TIFF with one entry, the orientation: to be turned by 90 degrees to the right.
        let exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        encoder.set_exif_metadata(exif.to_vec()).unwrap();
        encoder.encode_image(&image::imageops::rotate270(&photo)).unwrap();
    });
    let (_, turned, said) = scene.tuned();
    assert!(turned > straight - 1.0, "{straight} {turned} {said}");
}

#[test]
fn photos_of_other_views_are_refused_and_another_exposure_is_told() {
    // The names of the photos in the opposite order, and off by one.
    for other in [|i: usize| 31 - i, |i: usize| (i + 1) % 32] {
        let scene = Scene::new(|dir, stem, photo| {
            let i: usize = stem.strip_prefix("view_").unwrap().parse().unwrap();
            save(dir.join(format!("images/view_{:03}.png", other(i))), photo);
        });
        let out = scene.tune("");
        one_line(&out, "do not show this model at their cameras");
        assert!(heard(&out).contains("--force-photos"), "{out:?}");
        said(&scene.tune(" --force-photos"));
    }
    let scene = Scene::new(|dir, stem, mut photo| {
        photo.pixels_mut().for_each(|p| p.0 = p.0.map(|v| (f32::from(v) * 0.6) as u8));
        save(dir.join(format!("images/{stem}.png")), photo);
    });
    let (_, _, said) = scene.tuned();
    assert!(said.contains("exposure differs"), "{said}");
}

#[test]
fn photos_of_formats_that_are_not_read_are_named() {
    let scene = Scene::new(|dir, stem, _| {
        let file = dir.join(format!("images/{stem}.TIF"));
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, "II*").unwrap();
    });
    let out = scene.tune("");
    one_line(&out, "32 photos in ");
    let error = heard(&out);
    assert!(error.contains("are .TIF, which is not read; convert them to PNG or JPEG"), "{error}");
    assert!(error.contains("--distil"), "{error}");
}

#[test]
fn grey_photos_of_a_model_with_colours_are_refused_by_that_name() {
    let scene = Scene::new(|dir, stem, photo| {
        save(dir.join(format!("images/{stem}.png")), image::DynamicImage::from(photo).into_luma8());
    });
    let out = scene.tune("");
    one_line(&out, "all 28 photos are grey");
    assert!(heard(&out).contains("--force-photos"), "{out:?}");
    let forced = heard(&scene.tune(" --force-photos"));
    assert!(
        forced.contains("the tuned model turns grey") && !forced.contains("exposure"),
        "{forced}"
    );
}

#[test]
fn photos_of_16_bits_are_those_of_8() {
    let put = |wide: bool| {
        Scene::new(|dir, stem, photo| {
            let photo = image::DynamicImage::from(photo);
            let photo = if wide { photo.into_rgb16().into() } else { photo };
            save(dir.join(format!("images/{stem}.png")), photo);
        })
    };
    let [(_, eight, _), (_, sixteen, _)] = [put(false).tuned(), put(true).tuned()];
    assert!((eight - sixteen).abs() < 1e-9, "{eight} {sixteen}");
}

#[test]
fn photos_that_are_turned_are_said_to_be() {
    let scene = Scene::new(|dir, stem, photo| {
        save(dir.join(format!("images/{stem}.png")), image::imageops::rotate90(&photo));
    });
    one_line(
        &scene.tune(""),
        "80x120, but its camera has 240x160: the photo is turned by 90 degrees",
    );
}

/// Beside the figures of the room's model in docs/results/tune.md.
#[test]
fn compare_scores_both_models_against_the_photos() {
    let scene = Scene::new(|_, _, _| {});
    let stream = scene.path("a.gsvx");
    common::report("encode @ -q 50 --no-estimate -o @", &[&model(), &stream]);
    let line = "compare @ @ --cameras @ --every 8 --photos";
    let (said, _) = common::report(line, &[&model(), &stream, &room()]);
    let [reference, coded] = [0, 1].map(|i| {
        ["psnr", "ssim", "ssimulacra2"].map(|score| said["photos"][i][score].as_f64().unwrap())
    });
    for (got, want, tolerance) in [(0, 30.93, 0.01), (1, 0.9043, 1e-4), (2, 40.9, 0.1)] {
        assert!((reference[got] - want).abs() <= tolerance, "{reference:?}");
        assert!(coded[got] < reference[got], "{coded:?} {reference:?}");
    }
    let out = run(line, &[&model(), &stream, &scene.dir]);
    one_line(&out, "no photos; leave out --photos");
}
