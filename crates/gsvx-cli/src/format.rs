//! Formats on the command line: the models of [`Format::all`], and streams beside them.

use crate::exit::{note, usage};
use crate::output::{Output, Written, is_stdio};
use anyhow::Result;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use gs_model::{Format, Scene, sog};
use std::path::Path;

/// Extensions of OpenUSD.
const USD: [&str; 4] = [".usd", ".usda", ".usdc", ".usdz"];

/// What streams are called, and the extension of their files.
pub(crate) const STREAM: &str = "gsvx";

/// Reads the name of a format that is read.
pub(crate) fn read_name() -> impl TypedValueParser<Value = String> {
    let models = Format::all().iter().map(|f| PossibleValue::new(f.name).help(f.about));
    let stream = PossibleValue::new(STREAM).help("a gsvx stream");
    PossibleValuesParser::new(models.chain([stream]))
}

/// Reads the name of a format that is written.
pub(crate) fn written() -> impl TypedValueParser<Value = &'static Format> {
    let models = Format::all().iter().filter(|f| f.is_written());
    let models = models.map(|f| PossibleValue::new(f.name).help(f.about));
    PossibleValuesParser::new(models)
        .try_map(|name| Format::named(&name).ok_or_else(|| format!("no format {name}")))
}

/// The table of formats, for help texts.
pub(crate) fn table() -> String {
    let row = |f: &&Format| {
        let written = if f.is_written() { "" } else { " (read only)" };
        format!("  {:<16} {}{written}\n", f.name, f.about)
    };
    format!("Formats:\n{}", Format::all().iter().map(row).collect::<String>())
}

/// True for the name of a stream.
pub(crate) fn is_stream_name(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(STREAM))
}

/// Refuses the name of a model for a stream.
pub(crate) fn check_stream_name(output: &Path) -> Result<()> {
    let Some(format) = Format::of_name(output).filter(|f| f.is_written()) else { return Ok(()) };
    let (name, extension) = (output.display(), format.extensions[0]);
    Err(usage(format!(
        "{name}: encode writes gsvx streams; name it .gsvx, or use gsvx convert to write .{extension}"
    )))
}

/// The names of all formats that are written, as `pick` has them, separated by commas.
fn all_written(pick: impl Fn(&Format) -> String) -> String {
    let names = Format::all().iter().filter(|f| f.is_written()).map(|f| pick(f));
    names.collect::<Vec<_>>().join(", ")
}

/// The format of an output: the one asked for, or that of the output's extension. `other` is for
/// extensions that name none.
pub(crate) fn of_output(
    asked: Option<&'static Format>,
    path: &Path,
    other: Option<&'static Format>,
) -> Result<&'static Format> {
    let name = path.display();
    if let Some(format) = asked {
        return Ok(format);
    }
    if is_stream_name(path) {
        let why = "this command writes models; to write a stream, use gsvx encode";
        return Err(usage(format!("{name}: {why}")));
    }
    let named = Format::of_name(path);
    // A .gltf is named, but what is written is a .glb.
    let lower = name.to_string().to_ascii_lowercase();
    match named.filter(|f| f.is_written() && lower.ends_with(f.extensions[0])) {
        Some(format) => Ok(format),
        None if path.file_name().is_some_and(|name| name == sog::META) => Err(usage(format!(
            "{name}: gsvx convert writes a SOG of several files; name a .sog for one file"
        ))),
        None if USD.iter().any(|extension| lower.ends_with(extension)) => {
            Err(usage(format!("{name}: OpenUSD is written by gsvx.to_usd of the Python package")))
        }
        None if named.is_some() => Err(usage(format!(
            "{name}: this format is not written; write one of {}",
            all_written(|f| format!(".{}", f.extensions[0]))
        ))),
        None => other.ok_or_else(|| {
            let names = all_written(|f| f.name.into());
            usage(if is_stdio(path) {
                format!("standard output: name its format with --to {names}")
            } else {
                format!("{name}: its extension names no format; pass --to with one of {names}")
            })
        }),
    }
}

/// Says that a file does not tell where a model lies, if its format has no place for that.
pub(crate) fn say_lost_origin(name: &str, format: &Format, origin: [f64; 3]) {
    let [x, y, z] = origin;
    if origin != [0.0; 3] && !format.says_origin {
        note(format_args!(
            "warning: {name}: positions are relative to the origin ({x}, {y}, {z}), which .{} does not hold; write .ply or \
             .glb to keep it in the file",
            format.extensions[0]
        ));
    }
}

/// Says that a format holds positions in steps that show.
pub(crate) fn say_coarse_steps(name: &str, format: &Format, scene: &Scene) {
    if let Some(coarse) = format.coarse_steps(scene) {
        note(format_args!("warning: {name}: {coarse}"));
    }
}

/// Writes a model, and says what its format does not hold.
pub(crate) fn write(format: &Format, output: Output, scene: &Scene) -> Result<Written> {
    let name = output.name();
    let written = output.write(|out| Ok(format.write_to(&name, out, scene)?))?;
    say_losses(&name, format, scene);
    Ok(written)
}

/// Says what of a scene a format does not hold.
pub(crate) fn say_losses(name: &str, format: &Format, scene: &Scene) {
    say_lost_origin(name, format, scene.origin);
    say_coarse_steps(name, format, scene);
    let (kept, all) = (format.max_sh_degree, scene.sh_degree);
    if kept < all {
        let (first, format) = (kept + 1, format.extensions[0]);
        note(format_args!("skipped: SH degrees {first} to {all}: .{format} does not hold them"));
    }
    if scene.antialiased && !format.says_antialiased {
        note(format_args!(
            "skipped: .{} does not say that the model is antialiased, so viewers draw it with too much opacity",
            format.extensions[0]
        ));
    }
}
