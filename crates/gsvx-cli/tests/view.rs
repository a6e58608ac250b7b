//! `gsvx view`: what it serves, and how it ends.

mod common;

use common::{Folder, gsvx, json, ok, one_line, room, room_cameras};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use gs_model::Camera;

/// A running `gsvx view` and its address.
struct View {
    child: Child,
    host: String,
    page: String,
}

impl View {
    fn of(files: &[&std::path::Path]) -> Self {
        let mut child = gsvx()
            .args(["view", "--no-open"])
            .args(files)
            .stdout(Stdio::piped())
            .spawn()
            .expect("gsvx starts");
        let mut line = String::new();
        let out = child.stdout.as_mut().expect("its output");
        BufReader::new(out).read_line(&mut line).expect("the address");
        let page = line.trim().to_owned();
        let host = page["http://".len()..].split('/').next().expect("a host").to_owned();
        Self { child, host, page }
    }

    /// Status line, headers and body.
    fn get(&self, path: &str, headers: &str) -> (String, Vec<u8>) {
        let host = format!("Host: {}\r\n", self.host);
        self.send(&format!("GET {path} HTTP/1.1\r\n{host}Connection: close\r\n{headers}\r\n"))
    }

    /// As [`View::get`], for what the page alone asks for.
    fn post(&self, path: &str) -> (String, Vec<u8>) {
        let host = &self.host;
        let origin = format!("Origin: http://{host}\r\nContent-Length: 0\r\n");
        self.send(&format!("POST {path} HTTP/1.1\r\nHost: {host}\r\n{origin}\r\n"))
    }

    fn send(&self, request: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.host).expect("a connection");
        stream.write_all(request.as_bytes()).expect("the request is sent");
        let mut all = Vec::new();
        stream.read_to_end(&mut all).expect("an answer");
        let end = all.windows(4).position(|w| w == b"\r\n\r\n").expect("the end of the headers");
        (String::from_utf8_lossy(&all[..end]).into_owned(), all[end + 4..].to_vec())
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_first_camera_and_where_it_is_from_are_said() {
    let dir = Folder::new();
    let alone = dir.join("alone.ply");
    std::fs::copy(room().join("point_cloud.ply"), &alone).unwrap();
    let beside = room().join("point_cloud.ply");
    for (model, from) in [(&beside, "of the 32 cameras from"), (&alone, "a circle around")] {
        let mut child = gsvx()
            .args(["view", "--no-open"])
            .arg(model)
            .stdout(Stdio::piped())
            .spawn()
            .expect("gsvx starts");
        let out = BufReader::new(child.stdout.take().expect("its output"));
        let second = out.lines().nth(1).expect("a second line").expect("text");
        child.kill().expect("it runs");
        let _ = child.wait();
        assert!(second.starts_with("first camera: ") && second.contains(from), "{second}");
    }
}

#[test]
fn page_and_ranges_are_served() {
    let model = room().join("point_cloud.ply");
    let all = std::fs::read(&model).expect("the model");
    let view = View::of(&[&model]);
    // The cameras of the room say what is up.
    assert!(view.page.contains("/?url=/file/0/point_cloud.ply&up=0.0"), "{}", view.page);
    let (head, body) = view.get("/?url=x", "");
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("Content-Encoding: gzip"), "{head}");
    assert!(body.starts_with(&[0x1f, 0x8b]));
    let (head, body) = view.get("/file/0/point_cloud.ply", "");
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    assert!(head.contains(&format!("Content-Length: {}", all.len())), "{head}");
    assert!(body == all);
    let (head, body) = view.get("/file/0/point_cloud.ply", "Range: bytes=100-199\r\n");
    assert!(head.starts_with("HTTP/1.1 206"), "{head}");
    assert!(head.contains(&format!("Content-Range: bytes 100-199/{}", all.len())), "{head}");
    assert!(body == all[100..200]);
    let beyond = format!("Range: bytes={}-\r\n", all.len());
    assert!(view.get("/file/0/point_cloud.ply", &beyond).0.starts_with("HTTP/1.1 416"));
}

#[test]
fn the_page_is_told_the_budget_of_gaussians() {
    let model = room().join("point_cloud.ply");
    let View { page, .. } = &View::of(&["--budget".as_ref(), "500k".as_ref(), &model]);
    assert_eq!(numbers(page, "budget"), [500_000.0]);
    assert!(!View::of(&[&model]).page.contains("budget"));
    common::wrong_usage(&common::run("view --no-open --budget 0 @", &[&model]), "--budget");
}

/// The numbers of a parameter of the page's address.
fn numbers(page: &str, name: &str) -> Vec<f64> {
    let value = page.split('&').find_map(|p| p.strip_prefix(name)?.strip_prefix('='));
    value.expect(name).split(',').map(|v| v.parse().expect("a number")).collect()
}

#[test]
fn the_page_starts_at_the_first_training_camera() {
    let views = gs_model::dataset::open_views(room()).expect("cameras");
    // The first one is held out.
    let camera = &views[1].camera;
    let near = |a: &[f64], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    let (dir, room) = (Folder::new(), room().join("point_cloud.ply"));
    let alone = dir.join("alone.ply");
    std::fs::copy(&room, &alone).expect("a copy");
    // Also those of the second file.
    for files in [&[&*room][..], &[&alone, &room]] {
        let View { page, .. } = &View::of(files);
        assert!(near(&numbers(page, "eye"), camera.position().into()), "{page}");
        assert!(near(&numbers(page, "ahead"), camera.rotation.row(2).into()), "{page}");
        assert!((numbers(page, "angle")[0] - camera.narrow_angle()).abs() < 0.01, "{page}");
    }
}

#[test]
fn without_cameras_the_page_starts_where_an_orbit_does() {
    let dir = Folder::new();
    let alone = dir.join("alone.ply");
    std::fs::copy(room().join("point_cloud.ply"), &alone).expect("a copy");
    let View { page, .. } = &View::of(&[&alone]);
    let three = |name| <[f64; 3]>::try_from(numbers(page, name)).expect("three numbers");
    let (eye, up, angle) = (three("eye"), three("up"), numbers(page, "angle")[0]);
    let target = [0, 1, 2].map(|k| eye[k] + three("ahead")[k]);
    let focal = 240.0 / libm::tan(0.5 * angle.to_radians());
    let camera = Camera::looking_at("page".into(), eye, target, up, [640, 480], focal);
    let (scene, _) = gs_model::ply::read(&alone).expect("the model");
    let shown = finetune::render(&scene, &camera, &finetune::RenderOptions::default());
    let png = dir.join("orbit.png");
    common::ok("render @ --orbit 1 -o @", &[&alone, &png]);
    let orbit = image::open(&png).expect("the picture").to_rgb8();
    let orbit = finetune::Photo::new(640, 480, orbit.into_raw()).expect("its size");
    let psnr = finetune::metrics::psnr(&shown, &orbit.image());
    assert!(psnr > 40.0, "{psnr} dB");
}

/// The room without Gaussians that make it slow, and its cameras.
fn encoding(dir: &Folder, more: &[&str]) -> View {
    let (model, cameras) = (dir.small(), dir.join("cameras"));
    room_cameras(&cameras, "");
    let mut args = vec!["--encode".as_ref(), &*model, "--cameras".as_ref(), &*cameras];
    args.extend(more.iter().map(std::path::Path::new));
    View::of(&args)
}

#[test]
fn the_page_gets_streams_of_gsvx_encode_and_saves_them() {
    let dir = Folder::new();
    let view = encoding(&dir, &[]);
    assert!(view.page.ends_with("&encode=80&cameras=true"), "{}", view.page);
    let (model, cameras) = (dir.join("small.ply"), dir.join("cameras"));
    let (plain, by_cameras) = (dir.join("plain.gsvx"), dir.join("by_cameras.gsvx"));
    ok("encode @ -o @ -q 62.5 --no-estimate", &[&model, &plain]);
    let line = "encode @ -o @ -q 35 --cameras @";
    let told = json(line, &[&model, &by_cameras, &cameras])["estimated_loss"].clone();
    let body = |path: &str| {
        let (head, body) = view.post(path);
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        body
    };
    assert!(body("/encode?quality=62.5&cameras=false") == std::fs::read(&plain).unwrap());
    let saved = body("/save?quality=62.5&cameras=false");
    assert!(body("/encode?quality=35&cameras=true") == std::fs::read(by_cameras).unwrap());
    let loss = body("/estimate?quality=35&cameras=true");
    let loss: serde_json::Value = serde_json::from_slice(&loss).unwrap();
    for (name, value) in told.as_object().unwrap() {
        assert_eq!(loss[name], *value, "{name}");
    }
    assert!(loss["words"].as_str().unwrap().starts_with("estimated loss: about "), "{loss}");
    let ahead = loss["worst"]["ahead"].as_array().unwrap();
    let length: f64 = ahead.iter().map(|v| v.as_f64().unwrap()).map(|v| v * v).sum();
    assert!((length - 1.0).abs() < 1e-9, "{loss}");
    // The estimate and the file are of the last stream only.
    for path in ["/estimate?quality=62.5&cameras=true", "/save?quality=62.5&cameras=false"] {
        assert!(view.post(path).0.starts_with("HTTP/1.1 409"), "{path}");
    }
    let saved: serde_json::Value = serde_json::from_slice(&saved).unwrap();
    let file = dir.join("small-q62.5.gsvx");
    assert!(std::fs::read(&file).unwrap() == std::fs::read(&plain).unwrap());
    let (model, file) = (model.display(), file.display());
    assert_eq!(saved["command"], format!("gsvx encode {model} -o {file} -q 62.5"));
    body("/encode?quality=62.5&cameras=false");
    let (head, why) = view.post("/save?quality=62.5&cameras=false");
    assert!(head.starts_with("HTTP/1.1 409"), "{head}");
    let why = String::from_utf8(why).unwrap();
    assert_eq!(why, format!("{file}: already exists; pass --force to replace it"));
}

#[test]
fn only_the_page_starts_work() {
    let dir = Folder::new();
    let view = encoding(&dir, &["-o", dir.join("a b.gsvx").to_str().unwrap()]);
    let host = &view.host;
    let post =
        |more: &str| format!("POST /encode?quality=50 HTTP/1.1\r\nHost: {host}\r\n{more}\r\n");
    let other = format!("Origin: http://{host}.example.org\r\n");
    for (more, status) in [("", 403), (&*other, 403), ("Content-Length: 1\r\n", 413)] {
        let (head, _) = view.send(&post(more));
        assert!(head.starts_with(&format!("HTTP/1.1 {status}")), "{head}");
    }
    assert!(view.get("/encode?quality=50", "").0.starts_with("HTTP/1.1 404"));
    assert!(view.post("/encode?quality=101").0.starts_with("HTTP/1.1 400"));
    // A page that is closed while it waits leaves nothing behind.
    for quality in 0..40 {
        let mut stream = TcpStream::connect(host).expect("a connection");
        let request =
            post(&format!("Origin: http://{host}\r\n")).replace("50", &quality.to_string());
        stream.write_all(request.as_bytes()).expect("the request is sent");
    }
    assert_eq!(common::names(&dir), ["cameras", "small.ply"]);
    // What those asked for may still be before it.
    let saved = (0..100).find_map(|_| {
        view.post("/encode?quality=20&cameras=true");
        let (head, saved) = view.post("/save?quality=20&cameras=true");
        head.starts_with("HTTP/1.1 200").then_some(saved)
    });
    let saved = String::from_utf8(saved.expect("a stream")).unwrap();
    assert!(saved.contains("a b.gsvx' -q 20 --cameras "), "{saved}");
    assert_eq!(common::names(&dir), ["a b.gsvx", "cameras", "small.ply"]);
}

#[test]
fn what_cannot_be_encoded_is_told_before_the_page_opens() {
    let dir = Folder::new();
    let model = dir.small();
    let view = View::of(&[&model]);
    let line = format!("view --no-open @ --port {}", view.host.split(':').nth(1).unwrap());
    one_line(&common::run(&line, &[&model]), "name another with --port");
    let other = dir.join("other.ply");
    common::wrong_usage(
        &common::run("view --no-open --encode @ -o @", &[&model, &other]),
        "name it .gsvx",
    );
    let nowhere = dir.join("nowhere/small.gsvx");
    one_line(
        &common::run("view --no-open --encode @ -o @", &[&model, &nowhere]),
        "no such directory",
    );
    common::wrong_usage(
        &common::run("view --no-open --encode @ @", &[&model, &model]),
        "one model",
    );
    common::wrong_usage(&common::run("view --no-open @ --force", &[&model]), "--encode");
    let stream = dir.join("small.gsvx");
    ok("encode @ -o @ --no-estimate", &[&model, &stream]);
    one_line(&common::run("view --no-open --encode @", &[&stream]), "is a gsvx stream already");
    one_line(&common::run("view --no-open --encode @ -o @", &[&model, &stream]), "--force");
}

#[test]
fn nothing_else_is_served() {
    let view = View::of(&[&room().join("point_cloud.ply")]);
    for path in ["/file/1/point_cloud.ply", "/file/0/other", "/file/0/../README.md", "/etc/passwd"]
    {
        assert!(view.get(path, "").0.starts_with("HTTP/1.1 404"), "{path}");
    }
    let (head, _) = view.send("GET / HTTP/1.1\r\nHost: example.org\r\nConnection: close\r\n\r\n");
    assert!(head.starts_with("HTTP/1.1 403"), "{head}");
    let host = &view.host;
    let post = format!(
        "POST / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
    );
    assert!(view.send(&post).0.starts_with("HTTP/1.1 405"));
}

#[test]
fn a_body_is_refused_whatever_its_claimed_length() {
    let view = View::of(&[&room().join("point_cloud.ply")]);
    for host in [view.host.as_str(), "example.org"] {
        for body in
            ["Content-Length: 99999999999", "Content-Length: x", "Transfer-Encoding: chunked"]
        {
            let request = format!("GET / HTTP/1.1\r\nHost: {host}\r\n{body}\r\n\r\n");
            let (head, _) = view.send(&request);
            assert!(head.starts_with("HTTP/1.1 413"), "{head}");
        }
    }
    assert!(view.get("/", "").0.starts_with("HTTP/1.1 200"));
}

#[test]
fn the_head_of_a_request_is_bounded() {
    let view = View::of(&[&room().join("point_cloud.ply")]);
    let long = format!("X: {}\r\n", "x".repeat(1 << 20));
    for headers in [long, "X: x\r\n".repeat(1000)] {
        let mut stream = TcpStream::connect(&view.host).expect("a connection");
        let request = format!("GET / HTTP/1.1\r\nHost: {}\r\n{headers}\r\n", view.host);
        // The server need not take all of it.
        let _ = stream.write_all(request.as_bytes());
        let mut start = [0; 12];
        if stream.read_exact(&mut start).is_ok() {
            assert_eq!(&start, b"HTTP/1.1 431");
        }
    }
    assert!(view.send("GET\r\n\r\n").0.starts_with("HTTP/1.1 400"));
    assert!(view.get("/", "").0.starts_with("HTTP/1.1 200"));
}

#[test]
fn clients_that_do_not_read_do_not_block_others() {
    let view = View::of(&[&room().join("point_cloud.ply")]);
    let request = format!("GET /file/0/point_cloud.ply HTTP/1.1\r\nHost: {}\r\n\r\n", view.host);
    let idle = (0..12).map(|_| {
        let mut stream = TcpStream::connect(&view.host).expect("a connection");
        stream.write_all(request.as_bytes()).expect("the request is sent");
        stream
    });
    let silent = (0..12).map(|_| TcpStream::connect(&view.host).expect("a connection"));
    let _open: Vec<TcpStream> = idle.collect::<Vec<_>>().into_iter().chain(silent).collect();
    assert!(view.get("/", "").0.starts_with("HTTP/1.1 200"));
}

#[cfg(unix)]
#[test]
fn an_interruption_is_the_end_and_no_error() {
    let mut view = View::of(&[&room().join("point_cloud.ply")]);
    let pid = view.child.id().to_string();
    std::process::Command::new("kill").args(["-INT", &pid]).status().expect("kill runs");
    assert_eq!(view.child.wait().expect("it ends").code(), Some(0));
}

#[test]
fn a_file_that_is_not_there_is_named() {
    one_line(&common::run("view --no-open nothing.gsvx", &[]), "nothing.gsvx: cannot be read");
}
