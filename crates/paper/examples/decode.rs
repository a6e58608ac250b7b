//! Opens a stream of the paper's coding: `decode STREAM.paper OUT.ply`.
#![allow(unused_crate_dependencies, reason = "an example of one call")]

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(stream), Some(out)) = (args.next(), args.next()) else {
        return Err("usage: decode STREAM.paper OUT.ply".into());
    };
    let scene = paper::decode(&std::fs::read(stream)?)?;
    gs_model::ply::write(&out, &scene)?;
    println!("{out}: {} Gaussians", scene.len());
    Ok(())
}
