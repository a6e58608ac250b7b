//! What tasks need beside Rust and this repository. It is looked for before a task starts, and installed where one
//! command does that.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Result, bail};
use eval::printed;

/// Something that a task needs.
pub(crate) enum Need {
    /// A target of the Rust toolchain.
    Target(&'static str),
    /// Programs or files of a Debian package.
    Package { what: &'static str, package: &'static str, is_there: fn() -> bool },
    /// Node, and npm, which comes with it.
    Node,
}

pub(crate) const WASM: &str = "wasm32-unknown-unknown";
pub(crate) const ARM: &str = "aarch64-unknown-linux-gnu";
pub(crate) const ARM_LINKER: &str = "aarch64-linux-gnu-gcc";
pub(crate) const QEMU: &str = "qemu-aarch64";

/// A browser, for tests and benches.
pub(crate) const CHROMIUM: Need =
    Need::Package { what: "Chromium", package: "chromium", is_there: || chromium().is_some() };
/// Vulkan in software runs the WGSL kernels where there is no GPU.
pub(crate) const VULKAN: Need =
    Need::Package { what: "a driver of Vulkan", package: "mesa-vulkan-drivers", is_there: vulkan };
/// What builds and runs programs for 64-bit Arm.
pub(crate) const ON_ARM: [Need; 4] = [
    Need::Target(ARM),
    Need::Package {
        what: ARM_LINKER,
        package: "gcc-aarch64-linux-gnu",
        is_there: || on_path(ARM_LINKER).is_some(),
    },
    Need::Package {
        what: "the C library for 64-bit Arm",
        package: "libc6-dev-arm64-cross",
        is_there: || PathBuf::from(ARM_LIBRARY).join("lib").is_dir(),
    },
    Need::Package { what: QEMU, package: "qemu-user", is_there: || on_path(QEMU).is_some() },
];
/// Where the C library for Arm is.
pub(crate) const ARM_LIBRARY: &str = "/usr/aarch64-linux-gnu";

/// The oldest Node that runs the scripts.
const NODE: u32 = 20;

impl Need {
    /// Installs it unless it is there. The error names the command that installs it.
    pub(crate) fn get(&self) -> Result<()> {
        if !self.is_there() {
            self.install();
        }
        match self.missing() {
            Some(what) => bail!(what),
            None => Ok(()),
        }
    }

    /// What is missing, with the remedy.
    pub(crate) fn missing(&self) -> Option<String> {
        let says = || match self {
            Self::Target(triple) => {
                format!("the Rust target {triple} is missing: run `rustup target add {triple}`")
            }
            Self::Package { what, package, .. } => {
                format!("{what} is missing: on Debian run `sudo apt-get install {package}`")
            }
            Self::Node => format!("Node {NODE} or later, with npm, is missing: https://nodejs.org"),
        };
        (!self.is_there()).then(says)
    }

    fn is_there(&self) -> bool {
        match self {
            Self::Target(triple) => {
                let found = printed("rustc", &["--print", "target-libdir", "--target", triple]);
                found.is_some_and(|dir| PathBuf::from(dir).read_dir().is_ok_and(|d| d.count() > 0))
            }
            Self::Package { is_there, .. } => is_there(),
            Self::Node => {
                let version = printed("node", &["--version"]);
                let major = |v: &str| v.strip_prefix('v')?.split('.').next()?.parse::<u32>().ok();
                version.as_deref().and_then(major).is_some_and(|n| n >= NODE)
                    && printed("npm", &["--version"]).is_some()
            }
        }
    }

    /// Whether that worked is seen by what is there afterwards.
    fn install(&self) {
        match self {
            Self::Target(triple) => drop(runs("rustup", &["target", "add", triple])),
            Self::Package { package, .. } => {
                let install = ["install", "-y", "-qq", "--no-install-recommends", package];
                let _ = runs("apt-get", &["update", "-qq"]) && runs("apt-get", &install);
            }
            Self::Node => {}
        }
    }
}

/// Gets all; the error names each that cannot be had.
pub(crate) fn all(needs: &[Need]) -> Result<()> {
    let lacking: Vec<_> = needs.iter().filter_map(|n| n.get().err()).collect();
    if lacking.is_empty() {
        return Ok(());
    }
    bail!(lacking.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
}

/// `cargo xtask setup`: gets what tests skip without.
pub(crate) fn setup() -> Result<()> {
    all(&[Need::Target(WASM), VULKAN, CHROMIUM, Need::Node])
}

/// Where Chromium is: the environment variable CHROMIUM, or a program on the PATH.
pub(crate) fn chromium() -> Option<PathBuf> {
    let given = std::env::var_os("CHROMIUM").map(PathBuf::from).filter(|p| p.is_file());
    given
        .or_else(|| ["chromium", "chromium-browser", "google-chrome"].into_iter().find_map(on_path))
}

/// Whether Linux has a driver; other systems bring their own.
fn vulkan() -> bool {
    let has = |dir: &&str| PathBuf::from(dir).read_dir().is_ok_and(|d| d.count() > 0);
    !cfg!(target_os = "linux") || ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"].iter().any(has)
}

fn on_path(name: &str) -> Option<PathBuf> {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|dir| dir.join(&name)).find(|file| file.is_file())
}

/// Says the command and runs it; whether it succeeds.
fn runs(program: &str, words: &[&str]) -> bool {
    if on_path(program).is_none() {
        return false;
    }
    eprintln!("installing: {program} {}", words.join(" "));
    let mut command = Command::new(program);
    command.args(words).current_dir(eval::scenes::root());
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
