//! Processor time of every stage of a step, both executors.
//!
//! `cargo bench -p finetune --features gpu --bench stages [-- NAME ...]`; 100,000 Gaussians, SH 3,
//! 480x320, L1 + SSIM. With names, only the stages that contain one of them.

use finetune::probe::Stages;

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "common/scene.rs"]
mod scene;

/// Least and mean processor milliseconds of a run, over about a second.
fn measure(work: &mut dyn FnMut()) -> Option<(f64, f64)> {
    work();
    let (start, mut least, mut n) = (scene::cpu_seconds()?, f64::MAX, 0);
    loop {
        // Several runs per reading, because the clock has ticks of 10 ms.
        let from = scene::cpu_seconds()?;
        let mut batch = 0;
        while scene::cpu_seconds()? - from < 0.25 {
            work();
            batch += 1;
        }
        let now = scene::cpu_seconds()?;
        least = least.min((now - from) / f64::from(batch));
        n += batch;
        if now - start > 1.0 {
            return Some((1e3 * least, 1e3 * (now - start) / f64::from(n)));
        }
    }
}

fn main() {
    let names: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |name: &str| names.is_empty() || names.iter().any(|n| name.contains(n.as_str()));
    let (model, camera, photo) = scene::setup();
    let mut rust = Stages::new(&model, &camera, &photo).expect("a view of its photo's size");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut total = 0.0;
    for (k, name) in Stages::NAMES.iter().enumerate() {
        let name = format!("rust, one thread: {name}");
        if wanted(&name)
            && let Some((least, mean)) = measure(&mut || one.install(|| rust.run(k)))
        {
            println!("{name}: {least:.1} ms least, {mean:.1} ms mean");
            total += least;
        }
    }
    println!("rust: {total:.1} ms in all");
    #[cfg(feature = "gpu")]
    {
        let view = finetune::TrainView { camera, photo };
        let device = match finetune::probe::DeviceStages::new(&model, view) {
            Ok(device) => device,
            Err(e) => return println!("SKIPPED: {e}"),
        };
        let mut total = 0.0;
        for (k, name) in device.names().iter().enumerate() {
            let name = format!("wgsl: {name}");
            if wanted(&name)
                && let Some((least, mean)) = measure(&mut || device.run(k))
            {
                println!("{name}: {least:.1} ms least, {mean:.1} ms mean");
                total += least;
            }
        }
        println!("wgsl: {total:.1} ms in all");
    }
}
