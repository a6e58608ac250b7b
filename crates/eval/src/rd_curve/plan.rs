//! What a run does: views, voxelizations, qualities.

use anyhow::{Result, bail};
use gs_model::{Camera, Scene};
use paper::{CovarianceCoding, PaperOptions, Qp};
use voxel::{Merge, Strategy};

use super::options::{CurveOptions, Tuning};
use crate::progress::Bar;
use crate::study::{Study, slug};

/// Depths among which the uniform depth is chosen.
const DEPTHS: std::ops::RangeInclusive<u8> = 8..=18;
/// The uniform depth is the smallest at which the merged model renders like the original to
/// this many dB at training cameras: 10 dB above what trained models reach against photos, so
/// that voxelization is not what limits the curve.
const MERGED_DB: f64 = 40.0;
/// Training cameras used for that choice.
const CHOICE_VIEWS: usize = 3;

/// One voxelization.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Voxels {
    /// File-name part.
    pub(crate) name: String,
    /// Parameters in words.
    pub(crate) what: String,
    /// Where the octree stops.
    pub(crate) rule: Rule,
}

/// Where the octree stops.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Rule {
    /// As given.
    Given(Strategy, Merge),
    /// The codec's default at a quality: rate-distortion pruning.
    Default(f32, CameraUse),
}

/// What the codec's default knows of the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum CameraUse {
    /// Gaussians that the cameras hardly see are left out.
    DropUnseen,
    /// The cameras weigh each Gaussian, and none is left out.
    KeepUnseen,
    /// Nothing.
    NoCameras,
}

impl Voxels {
    /// A strategy, merged as gsvx merges ([`Merge::Moments`]) or as the paper initialises ([`Merge::Paper`]).
    pub(crate) fn given(strategy: &Strategy, merge: Merge) -> Self {
        let (name, what) = match strategy {
            Strategy::Uniform { depth } => (format!("uniform-{depth}"), format!("depth {depth}")),
            Strategy::Paper { large_percent, j_low, j_high, tau1, tau2 } => (
                format!("criteria-{j_low}-{j_high}-v{large_percent}-{tau1}-{tau2}"),
                format!("depths {j_low} to {j_high}"),
            ),
            Strategy::Released(r) => {
                (format!("released-{}", r.j_low), format!("released code from depth {}", r.j_low))
            }
            other => (slug(&format!("{other:?}")), format!("{other:?}")),
        };
        let name = if merge == Merge::Paper { format!("paper-{name}") } else { name };
        Self { name, what, rule: Rule::Given(strategy.clone(), merge) }
    }

    /// The codec's default at a quality.
    pub(crate) fn default(quality: f32, cameras: CameraUse) -> Self {
        let name = match cameras {
            CameraUse::DropUnseen => format!("gsvx-q{quality:.0}"),
            other => slug(&format!("gsvx-{other:?}-q{quality:.0}")),
        };
        Self { name, what: format!("quality {quality:.0}"), rule: Rule::Default(quality, cameras) }
    }
}

/// The paper's criteria about a uniform depth, as the paper has them about Playroom's (8 to 16 about 11).
pub(crate) fn criteria(uniform: u8) -> Strategy {
    Strategy::paper(uniform.saturating_sub(3).max(1), (uniform + 5).min(20))
}

/// One curve to make: codings grouped by the voxelization they have.
#[derive(Clone, Debug)]
pub(crate) struct CurvePlan {
    /// Short name, the same in all tables, legends and (as [`slug`]) file names.
    pub(crate) name: &'static str,
    /// One line for the legend.
    pub(crate) what: String,
    /// The fine-tune of each voxelized model.
    pub(crate) tuning: Option<Tuning>,
    /// Each voxelization with its codings, ascending.
    pub(crate) steps: Vec<(Voxels, Vec<Coding>)>,
}

/// How many levels the octree of a quality is deeper than the base depth. At low rates geometry is
/// half the stream, and a shallower octree saves more than it loses. At high rates the size of the
/// leaves limits the quality. The limits were measured on fox (uniform 10 to 13, qualities 34, 62,
/// 90).
fn levels_deeper(quality: f32) -> i32 {
    match quality {
        q if q < 27.0 => -1,
        q if q < 55.0 => 0,
        q if q < 83.0 => 1,
        _ => 2,
    }
}

/// The curves of a run; those that `options` ask for, around the depth `base`.
pub(crate) fn curves(base: u8, options: &CurveOptions, qualities: &[f32]) -> Vec<CurvePlan> {
    let CurveOptions { depth, sights, .. } = *options;
    let given = &options.adaptive;
    let shifted = |by: i32| (i32::from(base) + by).clamp(1, 20) as u8;
    let uniform = |q: f32| {
        let depth = depth.unwrap_or_else(|| shifted(levels_deeper(q)));
        Voxels::given(&Strategy::Uniform { depth }, Merge::Moments)
    };
    let paper = |q: f32| {
        let by = levels_deeper(q);
        let about = || Strategy::paper(shifted(by - 1), shifted(by + 2));
        Voxels::given(&given.clone().unwrap_or_else(about), Merge::Moments)
    };
    let plan = |name, what: &str, voxels: &dyn Fn(f32) -> Voxels| {
        let groups = qualities.chunk_by(|a, b| voxels(*a) == voxels(*b));
        let group = |all: &[f32]| (voxels(all[0]), all.iter().map(|&q| Coding::own(q)).collect());
        let steps: Vec<(Voxels, Vec<Coding>)> = groups.map(group).collect();
        let [first, last] = [steps.first(), steps.last()].map(|s| s.map_or("", |(v, _)| &v.what));
        let span = match first == last {
            true => first.to_owned(),
            false => format!("{first} at the smallest size, {last} at the largest"),
        };
        CurvePlan { name, what: format!("{what}, {span}"), tuning: None, steps }
    };
    let mut curves = vec![
        plan(UNIFORM, "gsvx's coding, every leaf of the octree at one depth", &uniform),
        plan(PAPER_CRITERIA, "gsvx's coding, leaves by the paper's adaptive criteria", &paper),
    ];
    // The paper: one model at all its rates, uniform and by its criteria, of which the hull takes the better.
    let strategies = [
        Strategy::Uniform { depth: depth.unwrap_or(base) },
        given.clone().unwrap_or_else(|| criteria(base)),
    ];
    for (name, tuning) in [(PAPER, None), (PAPER_TUNED, options.tuning())] {
        let steps = strategies.iter().map(|s| (Voxels::given(s, Merge::Paper), paper_codings()));
        let steps: Vec<_> = steps.collect();
        let [uniform, adaptive] = [&steps[0].0.what, &steps[1].0.what];
        let tuned = match tuning {
            Some(Tuning { steps, .. }) => format!("fine-tuned for {steps} steps"),
            None if name == PAPER_TUNED => continue,
            None => "not fine-tuned".into(),
        };
        let what = format!(
            "the paper's voxelization, initialisation and coding, {tuned}: uniform ({uniform}) and by its criteria \
             ({adaptive}), covariances by a codebook and without loss"
        );
        curves.push(CurvePlan { name, what, tuning, steps });
    }
    if sights {
        let what = "gsvx without cameras";
        curves.push(plan(NO_CAMERAS, what, &|q| Voxels::default(q, CameraUse::NoCameras)));
        let what = "gsvx with what the cameras hardly see";
        curves.push(plan(ALL_KEPT, what, &|q| Voxels::default(q, CameraUse::KeepUnseen)));
    }
    let what = "this codec: leaves by rate and distortion, precision by importance";
    curves.push(plan(GSVX, what, &|q| Voxels::default(q, CameraUse::DropUnseen)));
    curves
}

/// Names of the curves.
pub(crate) const UNIFORM: &str = "uniform";
pub(crate) const PAPER_CRITERIA: &str = "paper's criteria";
pub(crate) const PAPER: &str = "paper, not tuned";
pub(crate) const PAPER_TUNED: &str = "paper, fine-tuned";
pub(crate) const NO_CAMERAS: &str = "gsvx, no cameras";
pub(crate) const ALL_KEPT: &str = "gsvx, unseen kept";
pub(crate) const GSVX: &str = "gsvx";
pub(crate) const TUNED: &str = "gsvx, tuned";

/// How a voxelized model is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coding {
    /// The quality; of the paper's coding, that under which the QPs appear in tables.
    pub(crate) quality: f32,
    /// The QPs of the paper's coding, and whether covariances are coded without loss, or by a codebook.
    pub(crate) paper: Option<(Qp, bool)>,
}

/// QP triples on the hulls of the authors' published curves, lowest rate first: AC, DC, opacity,
/// and the quality under which each appears.
pub(crate) const PAPER_QPS: [(u8, u8, u8, f32); 6] = [
    (40, 28, 40, 20.0),
    (38, 16, 28, 34.0),
    (34, 16, 16, 48.0),
    (31, 4, 16, 62.0),
    (28, 4, 4, 76.0),
    (16, 4, 4, 90.0),
];

/// The paper's coding of one model: all triples, with the codebook and without loss.
pub(crate) fn paper_codings() -> Vec<Coding> {
    let coding = |lossless| {
        move |&(ac, dc, opacity, quality): &(u8, u8, u8, f32)| Coding {
            quality,
            paper: Some((Qp { ac, dc, opacity }, lossless)),
        }
    };
    [false, true].into_iter().flat_map(|lossless| PAPER_QPS.iter().map(coding(lossless))).collect()
}

impl Coding {
    /// The codec's default at a quality.
    pub(crate) fn own(quality: f32) -> Self {
        Self { quality, paper: None }
    }

    /// File-name part.
    pub(crate) fn name(&self) -> String {
        let lossless = self.paper.is_some_and(|(_, lossless)| lossless);
        format!("q{:.0}{}", self.quality, if lossless { "-lossless" } else { "" })
    }

    /// Quality or QPs in words.
    pub(crate) fn setting(&self) -> String {
        let Some((Qp { ac, dc, opacity }, lossless)) = self.paper else {
            return format!("{:.0}", self.quality);
        };
        let covariance = if lossless { ", lossless covariance" } else { "" };
        format!("QP {ac}/{dc}/{opacity}{covariance}")
    }

    /// Options of the paper's coding of so many Gaussians.
    pub(crate) fn paper(&self, gaussians: usize) -> Option<PaperOptions> {
        let (qp, lossless) = self.paper?;
        let covariance = match lossless {
            true => CovarianceCoding::Lossless,
            false => CovarianceCoding::codebook_for(gaussians),
        };
        Some(PaperOptions { qp, covariance })
    }
}

/// Depth of the uniform octree: the given one, or the one that rendering asks for.
pub(crate) fn depth(study: &Study, given: Option<u8>) -> Result<u8> {
    let choose = || choose_depth(&study.test.model, &study.test.training);
    given.map_or_else(|| study.cache.run("depth", &(), choose), Ok)
}

fn choose_depth(scene: &Scene, cameras: &[Camera]) -> Result<u8> {
    let step = cameras.len().div_ceil(CHOICE_VIEWS).max(1);
    let cameras: Vec<&Camera> = cameras.iter().step_by(step).collect();
    if cameras.is_empty() {
        bail!("the scene has no training camera to choose the depth with: give --depth");
    }
    let options = finetune::RenderOptions::default();
    let bar = Bar::new("choose depth", DEPTHS.count() as u64);
    let originals: Vec<_> = cameras.iter().map(|c| finetune::render(scene, c, &options)).collect();
    let cube = voxel::cube_of(&scene.means)?;
    for depth in DEPTHS {
        let voxels = voxel::voxelize(scene, &cube, &Strategy::Uniform { depth })?;
        let merged = voxel::merge(scene, &voxels, Merge::Moments)?;
        let total: f64 = cameras
            .iter()
            .zip(&originals)
            .map(|(c, o)| finetune::metrics::psnr(&finetune::render(&merged, c, &options), o))
            .sum();
        bar.step(1);
        if total / cameras.len() as f64 >= MERGED_DB || depth == *DEPTHS.end() {
            bar.done();
            return Ok(depth);
        }
    }
    bail!("no depth is left to choose")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_is_coded_at_six_triples_and_in_both_modes() {
        let all = paper_codings();
        let settings: Vec<String> = all.iter().map(Coding::setting).collect();
        assert_eq!(settings[0], "QP 40/28/40");
        assert_eq!(settings[6..].len(), 6);
        assert!(settings[6..].iter().all(|s| s.ends_with(", lossless covariance")));
        assert_eq!(all[6].name(), "q20-lossless");
    }

    /// Fine-tuned unless that is not wanted, uniform and by the criteria at the paper's distance.
    #[test]
    fn the_paper_is_its_whole_chain() {
        let mut options = CurveOptions::of("room").unwrap();
        let names = |options: &CurveOptions| -> Vec<&str> {
            curves(11, options, &[50.0, 60.0]).iter().map(|c| c.name).collect()
        };
        assert_eq!(names(&options), [UNIFORM, PAPER_CRITERIA, PAPER, PAPER_TUNED, GSVX]);
        let plans = curves(11, &options, &[50.0, 60.0]);
        let rules: Vec<&Rule> = plans[3].steps.iter().map(|s| &s.0.rule).collect();
        let uniform = Rule::Given(Strategy::Uniform { depth: 11 }, Merge::Paper);
        assert_eq!(rules, [&uniform, &Rule::Given(Strategy::paper(8, 16), Merge::Paper)]);
        assert!(plans[3].tuning.is_some_and(|t| t.steps == 400 && t.initialised));
        assert!(plans[2].tuning.is_none() && plans[4].tuning.is_none());
        options.finetune = Some(0);
        assert!(!names(&options).contains(&PAPER_TUNED));
    }

    #[test]
    fn qualities_of_one_voxelization_stay_together() {
        let mut options = CurveOptions::of("room").unwrap();
        let q = options.qualities().unwrap();
        for plan in curves(11, &options, &q).iter().filter(|p| !p.name.starts_with("paper,")) {
            let all = plan.steps.iter().flat_map(|(_, codings)| codings);
            assert!(all.map(|c| c.quality).eq(q.iter().copied()), "{}", plan.name);
        }
        (options.depth, options.adaptive) = (Some(12), Some(Strategy::paper(9, 14)));
        let fixed = curves(11, &options, &q);
        assert_eq!((fixed[0].steps.len(), fixed[1].steps.len()), (1, 1));
        let uniform = Rule::Given(Strategy::Uniform { depth: 12 }, Merge::Moments);
        assert_eq!(fixed[0].steps[0].0.rule, uniform);
    }

    #[test]
    fn the_chosen_depth_resolves_the_scene() {
        // Two Gaussians, two pixels apart: they must not fall into one voxel.
        let scene = Scene {
            means: vec![[0.0, 0.0, 0.0], [0.002, 0.0, 0.0], [1.0, 1.0, 1.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            log_scales: vec![[-7.0; 3]; 3],
            opacity_logits: vec![3.0; 3],
            sh_degree: 0,
            sh: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            ..Scene::default()
        };
        let (eye, up) = ([0.0, 0.0, -1.0], [0.0, -1.0, 0.0]);
        let camera = Camera::looking_at("a".into(), eye, [0.0; 3], up, [32; 2], 1000.0);
        let depth = choose_depth(&scene, &[camera]).unwrap();
        let cube = voxel::cube_of(&scene.means).unwrap();
        let voxels = voxel::voxelize(&scene, &cube, &Strategy::Uniform { depth }).unwrap();
        assert_eq!(voxels.len(), 3, "depth {depth}");
    }
}
