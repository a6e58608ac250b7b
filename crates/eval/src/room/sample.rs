//! From surfaces to flat Gaussians: charts are split where the picture needs detail, and each
//! cell becomes one disc.

use glam::{DMat3, DQuat, DVec3};
use gs_model::{Camera, Scene};
use rayon::prelude::*;
use testing::Rng;

use super::furniture::Room;
use super::light::{Samples, display, leaving, surface_of};
use super::patch::{Patch, patches};
use super::sh_fit::{Fit, Sample};
use crate::progress::Bar;

/// Cells start about this large, metres.
const COARSE: f64 = 0.30;
/// Standard deviation of a disc over the side of its cell: neighbours overlap enough to close
/// the surface and little enough to keep it sharp.
const SPREAD: f64 = 0.55;
/// Thickness of a disc over its smaller radius.
const FLATNESS: f64 = 0.12;
/// Least thickness, metres.
const THINNEST: f64 = 0.0015;
/// Opacity of every disc before a fit changes it.
const OPACITY: f64 = 0.995;
/// Share of the worst cells that a round of splitting takes.
const ROUND: f64 = 0.10;
/// Points per axis at which a cell is looked at.
const PROBES: u32 = 4;
/// Light paths per probe. All probes of a cell share their random numbers, so that noise does
/// not look like detail.
const PROBE_PATHS: u32 = 24;
/// Light paths per Gaussian and direction when its colour is fitted.
const COLOUR_PATHS: u32 = 40;
/// Extra directions over the hemisphere that hold the fit where no camera looks from.
const SPARE_DIRECTIONS: u32 = 24;

/// A rectangle of a chart.
#[derive(Clone, Debug)]
struct Cell {
    patch: Patch,
    u: f64,
    v: f64,
    width: f64,
    height: f64,
    /// Position in the order of creation; keys the random stream.
    id: u64,
    /// Squared colour error over all photos, in pixels.
    error: f64,
    /// Cameras that see the cell's centre.
    seen_by: Vec<u32>,
}

/// Samples about `target` Gaussians from the surfaces that `cameras` see.
pub(crate) fn gaussians(room: &Room, cameras: &[Camera], target: usize, seed: u64) -> Scene {
    let mut cells = start(room, cameras, seed);
    let bar = Bar::new("split surfaces", target as u64);
    bar.step(cells.len() as u64);
    let mut next_id = cells.len() as u64;
    while cells.len() < target {
        // Worst first. Ids break ties, so that the order is unique.
        cells.sort_by(|a, b| b.error.total_cmp(&a.error).then(a.id.cmp(&b.id)));
        let room_left = (target - cells.len()).div_ceil(3);
        let count = ((cells.len() as f64 * ROUND) as usize).clamp(1, room_left);
        let worst: Vec<Cell> = cells.drain(..count).collect();
        let mut children: Vec<Cell> = worst.iter().flat_map(quarters).collect();
        for child in &mut children {
            child.id = next_id;
            next_id += 1;
        }
        children.par_iter_mut().for_each(|c| rate(c, room, cameras, seed));
        children.retain(|c| !c.seen_by.is_empty());
        bar.step((children.len()).saturating_sub(count) as u64);
        cells.extend(children);
    }
    bar.done();
    cells.sort_by_key(|c| c.id);
    to_gaussians(room, cameras, &cells, seed)
}

fn start(room: &Room, cameras: &[Camera], seed: u64) -> Vec<Cell> {
    let mut cells = Vec::new();
    for patch in patches(room) {
        let (across, up) = patch.grid(room, COARSE);
        let (width, height) = (1.0 / f64::from(across), 1.0 / f64::from(up));
        for j in 0..up {
            for i in 0..across {
                let (u, v) = (f64::from(i) * width, f64::from(j) * height);
                let id = cells.len() as u64;
                cells.push(Cell { patch, u, v, width, height, id, error: 0.0, seen_by: vec![] });
            }
        }
    }
    cells.par_iter_mut().for_each(|c| rate(c, room, cameras, seed));
    cells.retain(|c| !c.seen_by.is_empty());
    cells
}

fn quarters(cell: &Cell) -> [Cell; 4] {
    let (width, height) = (cell.width / 2.0, cell.height / 2.0);
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(i, j)| Cell {
        u: cell.u + i * width,
        v: cell.v + j * height,
        width,
        height,
        ..cell.clone()
    })
}

/// Which cameras see the point from its front, inside their picture.
fn viewers(room: &Room, cameras: &[Camera], p: DVec3, n: DVec3) -> Vec<u32> {
    let sees = |camera: &Camera| {
        let position = camera.position();
        if n.dot(position - p) <= 0.0 {
            return false;
        }
        let q = camera.rotation * p + camera.translation;
        if q.z < 0.1 {
            return false;
        }
        let (x, y) = (camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        // A margin: a disc outside the picture still reaches into it.
        (-20.0..w + 20.0).contains(&x)
            && (-20.0..h + 20.0).contains(&y)
            && room.clear(p + n * 1e-5, position)
    };
    (0..).zip(cameras).filter(|(_, c)| sees(c)).map(|(i, _)| i).collect()
}

/// Fills in who sees the cell and how wrong one colour would be for it.
fn rate(cell: &mut Cell, room: &Room, cameras: &[Camera], seed: u64) {
    let at =
        |i: f64, j: f64| cell.patch.at(room, cell.u + i * cell.width, cell.v + j * cell.height);
    let (centre, normal) = at(0.5, 0.5);
    // A camera sees a cell if it sees any of five of its points, because the cell may be half hidden.
    let mut seen_by: Vec<u32> = [(0.5, 0.5), (0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9)]
        .into_iter()
        .flat_map(|(i, j)| {
            let (p, n) = at(i, j);
            viewers(room, cameras, p, n)
        })
        .collect();
    seen_by.sort_unstable();
    seen_by.dedup();
    let (du, dv) =
        cell.patch.derivatives(room, cell.u + cell.width / 2.0, cell.v + cell.height / 2.0);
    let area = (du * cell.width).cross(dv * cell.height).length();
    let pixels: f64 = seen_by
        .iter()
        .map(|&c| {
            let camera = &cameras[c as usize];
            let gap = camera.position() - centre;
            let cos = (normal.dot(gap) / gap.length()).max(0.1);
            area * cos * camera.fx * camera.fy / gap.length_squared()
        })
        .sum();
    let Some(&viewer) = seen_by.get(seen_by.len() / 2) else {
        cell.seen_by = seen_by;
        return;
    };
    let eye = cameras[viewer as usize].position();
    let mut colours = Vec::with_capacity((PROBES * PROBES) as usize);
    let mut bend = 0.0;
    for j in 0..PROBES {
        for i in 0..PROBES {
            let (i, j) = ((f64::from(i) + 0.5) / 4.0, (f64::from(j) + 0.5) / 4.0);
            let (p, n) = at(i, j);
            bend += (n - normal).length_squared() / f64::from(PROBES * PROBES);
            colours.push(colour(room, cell, &[(p, n)], (eye - p).normalize(), PROBE_PATHS, seed));
        }
    }
    let mean = colours.iter().sum::<DVec3>() / colours.len() as f64;
    let variance =
        colours.iter().map(|c| (*c - mean).length_squared()).sum::<f64>() / colours.len() as f64;
    // Bent cells also lose their outline: weigh that like a colour error of a tenth.
    cell.error = pixels * (variance + 0.1 * bend);
    cell.seen_by = seen_by;
}

/// Display colour of a set of surface points towards `view`, from `paths` light paths in all.
fn colour(
    room: &Room,
    cell: &Cell,
    points: &[(DVec3, DVec3)],
    view: DVec3,
    paths: u32,
    seed: u64,
) -> DVec3 {
    let mut rng = Rng::keyed(seed, &[0xce11, cell.id]);
    let mut samples = Samples::shifted(&mut rng);
    let mut sum = DVec3::ZERO;
    for k in 0..paths as usize {
        let (p, n) = points[k % points.len()];
        let u = samples.next_point();
        let surface = surface_of(room, cell.patch.object, p, n);
        sum += leaving(room, &surface, view, [u[2], u[3], u[4], u[5]], &mut rng, 2);
    }
    display(sum / f64::from(paths))
}

/// Turns cells into Gaussians with fitted colours.
fn to_gaussians(room: &Room, cameras: &[Camera], cells: &[Cell], seed: u64) -> Scene {
    let bar = Bar::new("fit colours", cells.len() as u64);
    let coefficients: Vec<[[f32; 3]; 16]> = cells
        .par_iter()
        .map(|cell| {
            bar.step(1);
            fit_colour(room, cameras, cell, seed)
        })
        .collect();
    bar.done();
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    for (cell, sh) in cells.iter().zip(&coefficients) {
        let (u, v) = (cell.u + cell.width / 2.0, cell.v + cell.height / 2.0);
        let (mean, normal) = cell.patch.at(room, u, v);
        let (du, dv) = cell.patch.derivatives(room, u, v);
        let first = (du - normal * normal.dot(du)).normalize();
        let axes = DMat3::from_cols(first, normal.cross(first), normal);
        let q = DQuat::from_mat3(&axes).normalize();
        let (a, b) = (SPREAD * du.length() * cell.width, SPREAD * dv.length() * cell.height);
        let c = (FLATNESS * a.min(b)).max(THINNEST);
        scene.means.push(mean.as_vec3().to_array());
        scene.rotations.push([q.w, q.x, q.y, q.z].map(|x| x as f32));
        scene.log_scales.push([a, b, c].map(|s| libm::log(s) as f32));
        scene.opacity_logits.push(libm::log(OPACITY / (1.0 - OPACITY)) as f32);
        scene.sh.extend_from_slice(sh);
    }
    scene
}

fn fit_colour(room: &Room, cameras: &[Camera], cell: &Cell, seed: u64) -> [[f32; 3]; 16] {
    let (centre, normal) =
        cell.patch.at(room, cell.u + cell.width / 2.0, cell.v + cell.height / 2.0);
    let mut rng = Rng::keyed(seed, &[0xf17, cell.id]);
    let mut spots = Samples::shifted(&mut rng);
    let points: Vec<(DVec3, DVec3)> = (0..COLOUR_PATHS)
        .map(|_| {
            let s = spots.next_point();
            cell.patch.at(room, cell.u + s[0] * cell.width, cell.v + s[1] * cell.height)
        })
        .collect();
    let mut fit = Fit::default();
    let mut add = |toward: DVec3, weight: f64| {
        let c = colour(room, cell, &points, toward, COLOUR_PATHS, seed);
        // Splat renderers evaluate SH along the ray from the camera.
        fit.add(&Sample { direction: -toward, colour: c.to_array(), weight });
    };
    for &i in &cell.seen_by {
        add((cameras[i as usize].position() - centre).normalize(), 1.0);
    }
    let (t, b) = super::light::tangents(normal);
    for _ in 0..SPARE_DIRECTIONS {
        let z = 0.05 + 0.95 * rng.unit();
        let r = (1.0 - z * z).sqrt();
        let angle = std::f64::consts::TAU * rng.unit();
        let toward = t * (r * libm::cos(angle)) + b * (r * libm::sin(angle)) + normal * z;
        add(toward.normalize(), 0.15);
    }
    fit.solve()
}
