//! `gsvx convert --gaussians`: fewer Gaussians, in the format that the output has.

mod common;

use common::{Folder, heard, json, model, ok, one_line, report, room, run, wrong_usage};

#[test]
fn a_model_of_any_format_gets_the_number_that_is_asked_for() {
    let dir = Folder::new();
    let input = dir.small();
    let stream = dir.join("a.gsvx");
    ok("encode @ -o @ --lossless", &[&input, &stream]);
    for (from, to) in [(&input, "a.ply"), (&input, "a.spz"), (&stream, "b.ply"), (&input, "a.glb")]
    {
        let out = dir.join(to);
        let said = json("convert @ @ --gaussians 0.2k", &[from, &out]);
        assert_eq!(
            (&said["gaussians"], &said["input_gaussians"]),
            (&200.into(), &400.into()),
            "{to}"
        );
        assert_eq!(json("info @", &[&out])["gaussians"], 200, "{to}");
    }
    let said = ok("convert @ @ --gaussians 1 --force", &[&input, &dir.join("a.ply")]);
    assert!(said.contains("1 Gaussian of 400"), "{said}");
}

#[test]
fn by_cameras_the_model_looks_better_from_there() {
    let dir = Folder::new();
    let [plain, seen] = ["plain.ply", "seen.ply"].map(|name| dir.join(name));
    let (input, cameras) = (model(), room());
    ok("convert @ @ --gaussians 5k", &[&input, &plain]);
    ok("convert @ @ --gaussians 5k --cameras @", &[&input, &seen, &cameras]);
    let psnr = |path| {
        let said = json("compare @ @ --every 8 --cameras @", &[&input, path, &cameras]);
        let n = said["gaussians"][1].as_u64().unwrap();
        assert!((4950..=5000).contains(&n), "{n}");
        said["psnr"].as_f64().unwrap()
    };
    let (plain, seen) = (psnr(&plain), psnr(&seen));
    assert!(plain > 28.0 && seen > plain, "{plain} dB, with cameras {seen} dB");
}

#[test]
fn a_model_that_has_no_more_is_written_unchanged_and_said_so() {
    let dir = Folder::new();
    let (input, [same, fewer]) =
        (dir.small(), ["same.ply", "fewer.ply"].map(|name| dir.join(name)));
    ok("convert @ @", &[&input, &same]);
    for n in ["400", "2M"] {
        let (said, heard) =
            report(&format!("convert @ @ --gaussians {n} --force"), &[&input, &fewer]);
        assert_eq!(said["gaussians"], 400);
        assert!(heard.contains("400 Gaussians, no more than asked for"), "{heard}");
        assert!(std::fs::read(&same).unwrap() == std::fs::read(&fewer).unwrap());
    }
}

#[test]
fn a_number_that_is_none_is_refused_in_one_line() {
    let dir = Folder::new();
    let (input, out) = (dir.small(), dir.join("out.ply"));
    for n in ["0", "-5", "NaN", "inf", "0.1", "many", "2MB"] {
        let done = run(&format!("convert @ @ --gaussians {n}"), &[&input, &out]);
        wrong_usage(&done, "500k");
    }
    wrong_usage(&run("convert @ @ --cameras @", &[&input, &out, &room()]), "--gaussians");
    let glb = dir.join("a.glb");
    wrong_usage(&run("convert @ @ --gaussians 9 --compress", &[&input, &glb]), "--compress");
    let other = run("convert @ @ --gaussians 9 --cameras @", &[&input, &out, &dir.join("none")]);
    one_line(&other, "none");
    assert!(!out.exists() && !glb.exists(), "{}", heard(&other));
}
