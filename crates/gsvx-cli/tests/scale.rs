//! Scenes larger than memory, and scenes in parts: `gsvx encode --memory`, `gsvx plan`, `gsvx encode --part`,
//! `gsvx join`. Whatever the way, and however often it is killed, the stream is that of an encode in memory.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::LazyLock;
use std::time::Instant;

use common::{Folder, Moments, model, names, one_line, wrong_usage};
use gs_model::{Scene, ply};

/// Three files of a city of several tiles, the same Gaussians in one file, and the stream that an encode in memory
/// makes of them.
struct City {
    dir: Folder,
    inputs: Vec<PathBuf>,
    stream: Vec<u8>,
}

/// Rooms side by side. Those of the last file are small and among those of the others.
fn rooms(file: usize, copies: usize) -> Scene {
    let (mut room, _) = ply::read(model()).unwrap();
    room.antialiased = true;
    room.cut_sh(1);
    let mut scene = Scene { sh_degree: 1, ..Scene::default() };
    for copy in 0..copies {
        let first = scene.len();
        scene.append(&room);
        let (scale, x) = if file == 2 { (0.3, 7.0) } else { (1.0, 12.0) };
        for i in first..scene.len() {
            let jitter = 0.01 * ((i * 37 + file * 11) % 101) as f32 / 101.0;
            scene.means[i] = scene.means[i].map(|v| scale * v + jitter);
            scene.means[i][0] += x * copy as f32;
            scene.means[i][2] += 9.0 * file as f32;
            scene.log_scales[i] = scene.log_scales[i].map(|v| v + libm::logf(scale));
        }
    }
    scene
}

static CITY: LazyLock<City> = LazyLock::new(|| {
    let dir = Folder::new();
    let (room, _) = ply::read(model()).unwrap();
    let copies = 200_000 / room.len() + 1;
    let mut all = Scene { sh_degree: 1, ..Scene::default() };
    let mut inputs = Vec::new();
    for file in 0..3 {
        let scene = rooms(file, copies);
        let path = dir.join(format!("tile-{file}.ply"));
        ply::write(&path, &scene).unwrap();
        inputs.push(path);
        all.append(&scene);
    }
    let whole = dir.join("whole.ply");
    ply::write(&whole, &all).unwrap();
    let stream = dir.join("whole.gsvx");
    common::ok("encode --no-estimate @ -o @", &[&whole, &stream]);
    City { inputs, stream: std::fs::read(&stream).unwrap(), dir }
});

fn done(out: &Output) {
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}

fn run(command: &mut Command) {
    done(&command.output().unwrap());
}

/// `gsvx LINE INPUTS -o OUTPUT`.
fn of(line: &str, inputs: &[PathBuf], output: &Path) -> Command {
    let mut command = common::command(line, &[]);
    command.args(inputs).arg("-o").arg(output);
    command
}

/// Plans the city and encodes `n` parts.
fn parts(dir: &Path, n: usize) -> Vec<PathBuf> {
    let plan = dir.join("city.plan");
    if !plan.exists() {
        run(&mut of("plan", &CITY.inputs, &plan));
    }
    let each = |k: usize| {
        let part = dir.join(format!("part-{k}-of-{n}.gsvx"));
        if !part.exists() {
            let line = format!("encode --part {k}/{n}");
            run(&mut of(&line, std::slice::from_ref(&plan), &part));
        }
        part
    };
    (1..=n).map(each).collect()
}

#[test]
fn a_bound_on_memory_changes_no_byte() {
    let dir = Folder::new();
    let city = dir.join("city.gsvx");
    let out = of("encode --memory 500M", &CITY.inputs, &city).output().unwrap();
    done(&out);
    assert!(String::from_utf8_lossy(&out.stderr).contains("scratch files: about"), "{out:?}");
    assert!(std::fs::read(&city).unwrap() == CITY.stream);
    assert_eq!(names(&dir), ["city.gsvx"]);
    // One file too, on one thread, with scratch files elsewhere.
    let whole = CITY.dir.join("whole.ply");
    let (again, scratch) = (dir.join("again.gsvx"), dir.join("scratch"));
    let mut command = of("encode --memory 1G --threads 1", &[whole], &again);
    run(command.arg("--scratch").arg(&scratch));
    assert!(std::fs::read(&again).unwrap() == CITY.stream && !scratch.exists());
}

#[test]
fn an_antialiased_model_and_another_are_not_one_scene() {
    let dir = Folder::new();
    let mut scene = common::scene();
    let [with, without, output] = ["with.ply", "without.ply", "out.gsvx"].map(|n| dir.join(n));
    ply::write(&without, &scene).unwrap();
    scene.antialiased = true;
    ply::write(&with, &scene).unwrap();
    let words = "encode @ @ -o @";
    let out = common::run(words, &[&without, &with, &output]);
    let said = format!("{} is antialiased and {} is not", with.display(), without.display());
    let heard = common::heard(&out);
    assert!(!out.status.success() && heard.contains(&said), "{heard}");
    common::ok("encode @ @ --no-estimate -o @", &[&with, &with, &output]);
    assert!(gsvx::decode(&std::fs::read(&output).unwrap()).unwrap().antialiased);
}

#[test]
fn transparent_gaussians_are_left_out_and_counted_whatever_the_way() {
    let dir = Folder::new();
    let mut scene = common::scene();
    let drawn = scene.drawn().map_or(scene.len(), |drawn| drawn.len());
    scene.append(&scene.clone());
    let half = scene.len() / 2;
    scene.opacity_logits[half..].fill(-8.0);
    let (input, one, tiles) = ["model.ply", "one.gsvx", "tiles.gsvx"].map(|n| dir.join(n)).into();
    ply::write(&input, &scene).unwrap();
    let said = common::json("encode @ --no-estimate -o @", &[&input, &one]);
    assert_eq!(said["transparent"], scene.len() - drawn);
    let words = "encode @ --memory 500M -o @";
    let (said, heard) = common::report(words, &[&input, &tiles]);
    assert_eq!(
        (&said["transparent"], &said["input_gaussians"]),
        (&(scene.len() - drawn).into(), &drawn.into())
    );
    assert!(heard.contains("left out that no rasterizer draws"), "{heard}");
    assert!(std::fs::read(one).unwrap() == std::fs::read(tiles).unwrap());
}

#[test]
fn parts_joined_are_the_scene_in_memory() {
    let dir = Folder::new();
    let joined = dir.join("joined.gsvx");
    for n in [1, 2, 5] {
        let mut parts = parts(&dir, n);
        // Each part is a stream itself.
        assert!(gsvx::decode(&std::fs::read(&parts[0]).unwrap()).is_ok());
        parts.reverse();
        run(of("join", &parts, &joined).arg("--force"));
        assert!(std::fs::read(&joined).unwrap() == CITY.stream, "{n} parts");
    }
    let mut parts = parts(&dir, 5);
    let join = |parts: &[PathBuf]| of("join --force", parts, &joined).output().unwrap();
    let last = parts.split_off(4);
    one_line(&join(&parts), "parts are missing: 5/5");
    wrong_usage(&join(&[&parts[..], &parts[..1]].concat()), "the same part");
    let other = dir.join("part-2-of-2.gsvx");
    one_line(&join(&[&parts[..], &[other]].concat()), "different numbers of parts");
    let bytes = std::fs::read(&last[0]).unwrap();
    std::fs::write(&last[0], &bytes[..bytes.len() - 3]).unwrap();
    one_line(&join(&[parts, last].concat()), "part-5-of-5.gsvx: is no whole part");
    assert!(std::fs::read(&joined).unwrap() == CITY.stream);
}

#[test]
fn inputs_that_are_broken_or_change_are_named() {
    let dir = Folder::new();
    let mut inputs = Vec::new();
    for (i, name) in ["a.ply", "b.ply"].iter().enumerate() {
        ply::write(dir.join(name), &rooms(i, 1)).unwrap();
        inputs.push(dir.join(name));
    }
    run(&mut of("plan", &inputs, &dir.join("plan")));
    let part =
        || of("encode --part 1/1", &[dir.join("plan")], &dir.join("part.gsvx")).output().unwrap();
    done(&part());
    std::fs::remove_file(dir.join("part.gsvx")).unwrap();
    let mut moved = rooms(1, 1);
    moved.means[5][0] += 1e4;
    ply::write(dir.join("b.ply"), &moved).unwrap();
    one_line(&part(), "b.ply: has changed since the plan was made");
    moved.means[5][0] = f32::NAN;
    ply::write(dir.join("b.ply"), &moved).unwrap();
    let refused = of("plan", &inputs, &dir.join("plan2")).output().unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && said.contains("b.ply: Gaussian 5: mean is NaN"), "{said}");
    assert!(!dir.join("plan2").exists());
    // Invalid Gaussians can be left out, in every way alike.
    run(of("plan", &inputs, &dir.join("plan3")).arg("--drop-invalid"));
    run(&mut of("encode --part 1/1", &[dir.join("plan3")], &dir.join("part3.gsvx")));
    let out = of("encode --drop-invalid", &inputs, &dir.join("one.gsvx")).output().unwrap();
    done(&out);
    assert!(
        String::from_utf8_lossy(&out.stderr).contains("1 invalid Gaussian is left out"),
        "{out:?}"
    );
    run(&mut of("join", &[dir.join("part3.gsvx")], &dir.join("three.gsvx")));
    assert!(
        std::fs::read(dir.join("one.gsvx")).unwrap()
            == std::fs::read(dir.join("three.gsvx")).unwrap()
    );
}

#[test]
fn flags_that_need_the_scene_in_memory_are_refused() {
    let dir = Folder::new();
    let out = dir.join("out.gsvx");
    let with = |line: &str| of(line, &[model()], &out).output().unwrap();
    let wide = "--memory: pruning needs the whole scene in memory";
    wrong_usage(&with("encode --memory 1G --prune 0.1"), wide);
    // The plan holds all choices.
    let chosen =
        ["--quality 80", "--lod", "--web", "--max-sh-degree 1", "--drop-invalid", "--from ply"];
    for flag in chosen.into_iter().chain(["--cameras x", "--depth 9 --j-low 3"]) {
        wrong_usage(&with(&format!("encode --part 1/2 {flag}")), "--part");
    }
    wrong_usage(&with("encode --memory 1M"), "at least");
    wrong_usage(&with("encode --part 3/2"), "K/N");
    one_line(&with("encode --part 1/2"), "is no plan");
    let two = [model(), model()];
    let lossless = of("encode --lossless", &two, &out).output().unwrap();
    wrong_usage(&lossless, "several models as one scene");
    assert!(names(&dir).is_empty());
}

#[test]
fn a_web_stream_is_the_same_in_parts_and_in_memory() {
    let dir = Folder::new();
    let web = "encode --web --quality 80";
    run(&mut of(web, &[model()], &dir.join("memory.gsvx")));
    run(of(web, &[model()], &dir.join("parts.gsvx")).args(["--memory", "1G"]));
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(read("memory.gsvx") == read("parts.gsvx"));
    // The quality that was asked for, and not that of the preset.
    let step = gsvx::Steps::of_quality(80.0).unwrap();
    assert_eq!(gsvx::Index::parse(&read("memory.gsvx")).unwrap().header.steps, step);
}

#[test]
fn cameras_change_no_byte_between_one_machine_and_parts() {
    let dir = Folder::new();
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    // One tile: what cameras see is what they see in memory.
    let (first, second) = (rooms(0, 1), rooms(1, 1));
    let mut both = first.clone();
    both.append(&second);
    for (name, scene) in [("a.ply", &first), ("b.ply", &second), ("both.ply", &both)] {
        ply::write(dir.join(name), scene).unwrap();
    }
    let with = |line: &str, inputs: &[&str], output: &str| {
        let inputs: Vec<PathBuf> = inputs.iter().map(|i| dir.join(i)).collect();
        let mut command = of(line, &inputs, &dir.join(output));
        command.arg("--cameras").arg(common::room());
        command
    };
    run(&mut with("encode --no-estimate", &["both.ply"], "memory.gsvx"));
    run(&mut with("encode", &["a.ply", "b.ply"], "two.gsvx"));
    assert!(read("memory.gsvx") == read("two.gsvx"));
    let guessed =
        of("encode --no-estimate", &[dir.join("both.ply")], &dir.join("guessed.gsvx")).output();
    done(&guessed.unwrap());
    assert!(read("memory.gsvx") != read("guessed.gsvx"));
    // Several tiles: one process, and parts. Levels of detail too.
    let cameras =
        |command: &mut Command| run(command.arg("--lod").arg("--cameras").arg(common::room()));
    cameras(&mut of("encode --memory 1G", &CITY.inputs, &dir.join("one.gsvx")));
    cameras(&mut of("plan", &CITY.inputs, &dir.join("plan")));
    let part = |k: usize| {
        let name = format!("part-{k}.gsvx");
        run(&mut of(&format!("encode --part {k}/2"), &[dir.join("plan")], &dir.join(&name)));
        dir.join(&name)
    };
    run(&mut of("join", &[part(1), part(2)], &dir.join("joined.gsvx")));
    assert!(read("one.gsvx") == read("joined.gsvx"));
    let index = gsvx::Index::parse(&read("one.gsvx")).unwrap();
    assert_eq!(index.coarsest_lod(), 2);
    run(&mut of("lod", &[dir.join("one.gsvx")], &dir.join("web")));
    let decoded = of("decode --lod 2", &[dir.join("one.gsvx")], &dir.join("coarse.ply")).output();
    done(&decoded.unwrap());
    let coarse = ply::read(dir.join("coarse.ply")).unwrap().0.len();
    assert!((1000..20_000).contains(&coarse), "{coarse}");
    // Cameras of another place, and cameras that changed.
    let cameras = dir.join("cameras.json");
    let cameras_at = |z: f64| {
        let view = |i: usize| {
            format!(
                r#"{{"id":{i},"img_name":"v{i}","width":64,"height":48,"position":[0,0,{z}],
                   "rotation":[[1,0,0],[0,1,0],[0,0,1]],"fx":60,"fy":60}}"#
            )
        };
        std::fs::write(&cameras, format!("[{},{}]", view(0), view(1))).unwrap();
    };
    cameras_at(-3.0);
    run(of("plan", &[dir.join("a.ply")], &dir.join("plan2")).arg("--cameras").arg(&cameras));
    cameras_at(1000.0);
    let part = of("encode --part 1/1", &[dir.join("plan2")], &dir.join("part.gsvx")).output();
    one_line(&part.unwrap(), "cameras.json: has changed since the plan was made");
    let nothing = of("plan", &[dir.join("a.ply")], &dir.join("plan3"))
        .arg("--cameras")
        .arg(&cameras)
        .output();
    common::failed(&nothing.unwrap(), "these cameras see nothing of the model");
}

/// Kills a command again and again, each time later, until it ends. Returns how often, and how often it
/// said that it goes on.
fn until_done(
    mut command: impl FnMut() -> Command,
    kills: usize,
    moments: &mut Moments,
) -> [usize; 2] {
    let started = Instant::now();
    run(&mut command());
    let mut whole = started.elapsed();
    let (mut killed, mut resumed) = (0, 0);
    for kill in 0..=kills {
        let mut child = command().stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        if kill < kills {
            std::thread::sleep(moments.next(whole));
            // It may have ended by itself, where the first run took longer than others do.
            match child.try_wait().unwrap() {
                None => killed += 1,
                Some(_) => whole = whole.mul_f64(0.7),
            }
            child.kill().unwrap();
        }
        let out = child.wait_with_output().unwrap();
        resumed += usize::from(String::from_utf8_lossy(&out.stderr).contains("going on with"));
        if kill == kills {
            done(&out);
        }
    }
    [killed, resumed]
}

#[test]
fn killed_at_random_an_encode_goes_on_to_the_same_bytes() {
    let dir = Folder::new();
    let mut moments = Moments::new();
    let encode = || {
        let mut command = of("encode --memory 500M", &CITY.inputs, &dir.join("city.gsvx"));
        command.arg("--force");
        command
    };
    let [kills, resumed] = until_done(encode, 10, &mut moments);
    assert!(std::fs::read(dir.join("city.gsvx")).unwrap() == CITY.stream);
    println!("encode: {kills} kills, {resumed} runs went on");
    assert!(kills >= 5 && resumed >= 2, "{kills} kills, {resumed} runs went on");
    run(&mut of("plan", &CITY.inputs, &dir.join("plan")));
    for k in ["1/2", "2/2"] {
        let name = format!("part-{}.gsvx", &k[..1]);
        let part = || {
            let mut command =
                of(&format!("encode --force --part {k}"), &[dir.join("plan")], &dir.join(&name));
            command.args(["--memory", "500M"]);
            command
        };
        let [kills, resumed] = until_done(part, 5, &mut moments);
        println!("part {k}: {kills} kills, {resumed} runs went on");
    }
    let both = [dir.join("part-1.gsvx"), dir.join("part-2.gsvx")];
    let join = || of("join --force", &both, &dir.join("joined.gsvx"));
    let [kills, _] = until_done(join, 10, &mut moments);
    println!("join: {kills} kills");
    assert!(std::fs::read(dir.join("joined.gsvx")).unwrap() == CITY.stream);
    let left = names(&dir);
    let wanted = ["city.gsvx", "joined.gsvx", "part-1.gsvx", "part-2.gsvx", "plan"];
    assert_eq!(left, wanted);
}
