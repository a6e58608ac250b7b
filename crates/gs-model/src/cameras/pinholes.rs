//! [`pinholes`]: the pinhole cameras that together show what photos show.
//!
//! A lens that bends outwards shows more than the pinhole camera of its focal length; a fisheye or a panorama shows
//! what no pinhole camera can.

use std::f64::consts::PI;
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::cameras::camera::{self, Camera};
use crate::cameras::lens::{Bending, PANORAMA};
use crate::error::Result;

/// Up to this angle from the axis one pinhole camera shows what a photo shows; beyond, the faces of a cube do.
const ONE: f64 = 60.0;
/// Beyond this angle no picture of a pinhole camera stands for the photo, degrees.
const WIDE: f64 = 80.0;
/// Points along an edge of the photo.
const ALONG_EDGE: u32 = 64;
/// Degrees between angles that are looked at, and how often the last gap is halved.
const STEP: f64 = 1.0;
const HALVINGS: usize = 24;
/// What a face shows beyond the points that were looked at, in focal lengths.
const MARGIN: f64 = 0.1;
/// Longest edge of a pinhole camera that is wider than its photo, pixels.
const LONGEST: f64 = 16_384.0;

/// The faces of a cube around a camera: their names, and their axes (right, down, forward) in its coordinates.
const FACES: [(&str, [DVec3; 3]); 6] = [
    ("front", [DVec3::X, DVec3::Y, DVec3::Z]),
    ("right", [DVec3::NEG_Z, DVec3::Y, DVec3::X]),
    ("left", [DVec3::Z, DVec3::Y, DVec3::NEG_X]),
    ("down", [DVec3::X, DVec3::NEG_Z, DVec3::Y]),
    ("up", [DVec3::X, DVec3::Z, DVec3::NEG_Y]),
    ("back", [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z]),
];

/// What a camera's photo shows.
#[derive(Debug)]
enum Field {
    /// All directions, with so many pixels per radian.
    All(f64),
    /// The outermost directions: the azimuth, of length 1, and the angle from the axis, radians.
    Rim(Vec<([f64; 2], f64)>),
}

/// Pinhole cameras without lenses that together show all that the photos of `cameras` show, as finely. A camera without
/// a lens stays as it is. One whose lens shows more than the pinhole camera of its focal length gets a larger image, and
/// one whose lens shows more than 60 degrees to a side becomes the faces of a cube, cut to what is shown: 6 for a panorama.
///
/// The first face of each camera comes before the second of any, so that evenly chosen ones look in all directions.
/// `file` is for the message.
///
/// # Errors
/// [`crate::Error::BadCamera`] if a lens model is not known.
pub fn pinholes(file: &Path, cameras: &[Camera]) -> Result<Vec<Camera>> {
    let mut faces: [Vec<Camera>; 6] = Default::default();
    // Most cameras of a file share their lens.
    let mut last: Option<(&Camera, Option<Field>)> = None;
    for camera in cameras {
        let (_, field) = match last.take() {
            Some((other, field)) if same_photos(other, camera) => last.insert((camera, field)),
            _ => {
                let field =
                    field(camera).map_err(|reason| camera::bad(file, &camera.name, reason))?;
                last.insert((camera, field))
            }
        };
        for (of_face, one) in faces.iter_mut().zip(of_one(camera, field.as_ref())) {
            of_face.push(one);
        }
    }
    Ok(faces.into_iter().flatten().collect())
}

/// Why no picture of a pinhole camera can stand for a camera's photo: its lens shows more than 80 degrees to a side, or
/// its model is not known. `None` if one can.
#[must_use]
pub fn too_wide(camera: &Camera) -> Option<String> {
    let field = match field(camera) {
        Ok(field) => field?,
        Err(reason) => return Some(reason),
    };
    if field.angle() <= WIDE.to_radians() {
        return None;
    }
    let model = camera.lens.as_ref().map_or("", |lens| &lens.model);
    Some(match field {
        Field::All(_) => format!(
            "a panorama ({model}) is no picture of a pinhole camera: cut it into pinhole pictures, the faces of a cube for \
             example"
        ),
        Field::Rim(_) => format!(
            "its lens ({model}) shows {:.0} degrees to a side, more than a picture without distortion can: undistort the \
             photos, for example with `colmap image_undistorter`",
            field.angle().to_degrees()
        ),
    })
}

/// Refuses a camera whose photo no picture of a pinhole camera can stand for. `file` is for the message.
///
/// # Errors
/// [`crate::Error::BadCamera`] if the lens shows more than 80 degrees to a side, or its model is not known.
pub fn refuse_wide(file: &Path, camera: &Camera) -> Result<()> {
    too_wide(camera).map_or(Ok(()), |reason| Err(camera::bad(file, &camera.name, reason)))
}

impl Field {
    /// The largest angle from the axis, radians.
    fn angle(&self) -> f64 {
        match self {
            Self::All(_) => PI,
            Self::Rim(rim) => rim.iter().fold(0.0, |most, &(_, angle)| most.max(angle)),
        }
    }
}

/// What a camera with a lens shows; `None` without one. The error says that the model is not known.
fn field(camera: &Camera) -> Result<Option<Field>, String> {
    let Some(lens) = &camera.lens else { return Ok(None) };
    if lens.model == PANORAMA {
        return Ok(Some(Field::All(f64::from(camera.width) / (2.0 * PI))));
    }
    let Some(bending) = lens.bending() else {
        return Err(format!(
            "the lens model {} is not known: undistort the photos, for example with `colmap image_undistorter`",
            lens.model
        ));
    };
    let rim = border(camera).map(|azimuth| (azimuth, outermost(camera, &bending, azimuth)));
    Ok(Some(Field::Rim(rim.collect())))
}

/// The directions, of length 1, from the principal point to points on the photo's edges.
fn border(camera: &Camera) -> impl Iterator<Item = [f64; 2]> {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let sides = move |t: f64| [[t * w, 0.0], [w, t * h], [w - t * w, h], [0.0, h - t * h]];
    let points = (0..ALONG_EDGE).flat_map(move |i| sides(f64::from(i) / f64::from(ALONG_EDGE)));
    points.filter_map(|[x, y]| {
        let [x, y] = [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy];
        let length = (x * x + y * y).sqrt();
        (length > 0.0).then(|| [x / length, y / length])
    })
}

/// The largest angle from the axis, radians, up to which light from an azimuth falls on the photo, farther outwards the
/// larger the angle is. Beyond the angles that a lens was measured for, its polynomial may turn back.
fn outermost(camera: &Camera, bending: &Bending, azimuth: [f64; 2]) -> f64 {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    // The principal point may lie beside a photo that was cut.
    let on = |at: f64, centre: f64, edge: f64| {
        (centre.min(0.0) - 1e-6..=centre.max(edge) + 1e-6).contains(&at)
    };
    let radius = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        let [x, y] = bending.of_direction([sin * azimuth[0], sin * azimuth[1], cos])?;
        let [px, py] = [camera.fx * x + camera.cx, camera.fy * y + camera.cy];
        (on(px, camera.cx, w) && on(py, camera.cy, h)).then_some(x * x + y * y)
    };
    let step = STEP.to_radians();
    let (mut low, mut least) = (0.0, 0.0);
    for i in 1..=(180.0 / STEP) as u32 {
        let angle = f64::from(i) * step;
        match radius(angle) {
            Some(r) if r > least => (low, least) = (angle, r),
            _ => break,
        }
    }
    let mut high = (low + step).min(PI);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match radius(middle) {
            Some(r) if r > least => low = middle,
            _ => high = middle,
        }
    }
    low
}

/// Whether two cameras have the same lens and the same size of photos.
fn same_photos(a: &Camera, b: &Camera) -> bool {
    let numbers = |c: &Camera| [f64::from(c.width), f64::from(c.height), c.fx, c.fy, c.cx, c.cy];
    numbers(a) == numbers(b) && a.lens == b.lens
}

/// The pinhole cameras of one camera with this field.
fn of_one(camera: &Camera, field: Option<&Field>) -> Vec<Camera> {
    match field {
        None => vec![camera.clone()],
        Some(field @ Field::Rim(rim)) if field.angle() <= ONE.to_radians() => {
            vec![widened(camera, rim)]
        }
        Some(field) => faces(camera, field),
    }
}

/// The pinhole camera with an image that holds all directions within a rim, and its own.
fn widened(camera: &Camera, rim: &[([f64; 2], f64)]) -> Camera {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let mut sides = [0.0, w, 0.0, h];
    for &([x, y], angle) in rim {
        let r = libm::tan(angle);
        let at = [camera.fx * r * x + camera.cx, camera.fy * r * y + camera.cy];
        // A difference of less than a pixel does not change the size.
        for (k, edge) in [(0, w), (1, h)] {
            if at[k] < -1.0 {
                sides[2 * k] = at[k].min(sides[2 * k]);
            }
            if at[k] > edge + 1.0 {
                sides[2 * k + 1] = at[k].max(sides[2 * k + 1]);
            }
        }
    }
    let straight = Camera { lens: None, ..camera.clone() };
    if sides == [0.0, w, 0.0, h] {
        return straight;
    }
    let tangents = [0, 1, 2, 3].map(|k| {
        let (focal, centre) = if k < 2 { (camera.fx, camera.cx) } else { (camera.fy, camera.cy) };
        (sides[k] - centre) / focal
    });
    with_image(straight, [camera.fx, camera.fy], tangents)
}

/// The faces of a cube that show something of a field.
fn faces(camera: &Camera, field: &Field) -> Vec<Camera> {
    let focal = match field {
        Field::All(focal) => [*focal; 2],
        Field::Rim(_) => {
            let gain =
                camera.lens.as_ref().and_then(|l| l.bending()?.of_direction([1e-6, 0.0, 1.0]));
            let gain = gain.map_or(1.0, |[x, _]| x * 1e6);
            [camera.fx * gain, camera.fy * gain]
        }
    };
    let face = |(name, axes): (&str, [DVec3; 3])| {
        let turn = DMat3::from_cols(axes[0], axes[1], axes[2]).transpose();
        let tangents = match field {
            Field::All(_) => [-1.0, 1.0, -1.0, 1.0],
            Field::Rim(rim) => shown(rim, turn)?,
        };
        let own = Camera {
            name: format!("{} ({name})", camera.name),
            rotation: turn * camera.rotation,
            translation: turn * camera.translation,
            lens: None,
            ..camera.clone()
        };
        Some(with_image(own, focal, tangents))
    };
    FACES.into_iter().filter_map(face).collect()
}

/// The tangents (least and greatest of x, of y) of what a face shows of the directions within a rim.
fn shown(rim: &[([f64; 2], f64)], turn: DMat3) -> Option<[f64; 4]> {
    let mut sides = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    for &([x, y], angle) in rim {
        let steps = (angle.to_degrees() / STEP).ceil().max(1.0);
        for i in 0..=steps as u32 {
            let (sin, cos) = libm::sincos(angle * f64::from(i) / steps);
            let at = turn * DVec3::new(sin * x, sin * y, cos);
            // Directions right beside the face count: those between the points that are looked at may be in it.
            if at.z > 0.0 && at.x.abs().max(at.y.abs()) <= (1.0 + MARGIN) * at.z {
                let [u, v] = [at.x / at.z, at.y / at.z];
                sides = [sides[0].min(u), sides[1].max(u), sides[2].min(v), sides[3].max(v)];
            }
        }
    }
    let out = [0, 1, 2, 3].map(|k| (sides[k] + [-MARGIN, MARGIN][k % 2]).clamp(-1.0, 1.0));
    (sides[0] <= sides[1] && out[0] < out[1] && out[2] < out[3]).then_some(out)
}

/// A camera of these focal lengths whose image reaches to these tangents, or a coarser one if that were too large.
fn with_image(camera: Camera, focal: [f64; 2], tangents: [f64; 4]) -> Camera {
    let wide = [tangents[1] - tangents[0], tangents[3] - tangents[2]];
    let edge = (focal[0] * wide[0]).max(focal[1] * wide[1]);
    let factor = (LONGEST / edge).min(1.0);
    let [fx, fy] = focal.map(|f| factor * f);
    let size = |edge: f64| (edge.ceil() as u32).max(1);
    Camera {
        width: size(fx * wide[0]),
        height: size(fy * wide[1]),
        fx,
        fy,
        cx: -fx * tangents[0],
        cy: -fy * tangents[2],
        ..camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cameras::lens::Lens;

    fn camera(size: [u32; 2], focal: f64, lens: Option<(&str, &[f64])>) -> Camera {
        let (eye, target) = ([0.3, -0.2, 1.0], [2.0, 1.0, -1.0]);
        let mut out = Camera::looking_at("a".into(), eye, target, [0.0, 0.0, 1.0], size, focal);
        out.lens = lens.map(|(model, k)| Lens { model: model.into(), coefficients: k.into() });
        out
    }

    fn of(camera: &Camera) -> Vec<Camera> {
        let all = pinholes(Path::new("-"), std::slice::from_ref(camera)).unwrap();
        all.into_iter().map(|c| c.checked(Path::new("-")).unwrap()).collect()
    }

    /// Whether a pinhole camera shows a direction of the world, to within a pixel.
    fn shows(c: &Camera, direction: DVec3) -> bool {
        let d = c.rotation * direction;
        let [x, y] = [c.fx * d.x / d.z + c.cx, c.fy * d.y / d.z + c.cy];
        d.z > 0.0
            && (-1.0..=f64::from(c.width) + 1.0).contains(&x)
            && (-1.0..=f64::from(c.height) + 1.0).contains(&y)
    }

    /// Directions all around.
    fn sphere() -> impl Iterator<Item = DVec3> {
        (0..20_000).map(|i| {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 20_000.0;
            let (sin, cos) = libm::sincos(f64::from(i) * 2.399_963_229_728_653);
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cos, r * sin, z)
        })
    }

    #[test]
    fn pinhole_cameras_show_all_that_a_photo_shows() {
        for (size, focal, model, k, faces) in [
            ([1024, 512], 512.0, "EQUIRECTANGULAR", &[][..], 6),
            // 150 and 190 degrees across, and more towards the corners.
            ([800, 600], 305.6, "OPENCV_FISHEYE", &[0.0, 0.0, 0.0, 0.0], 5),
            ([600, 600], 181.0, "SIMPLE_RADIAL_FISHEYE", &[0.0], 6),
            ([600, 600], 170.0, "OPENCV_FISHEYE", &[0.05, -0.01, 0.0, 0.0], 6),
            ([400, 300], 400.0, "OPENCV_FISHEYE", &[0.03, 0.0, 0.0, 0.0], 1),
            ([640, 480], 420.0, "OPENCV", &[-0.25, 0.06, 0.002, -0.001], 1),
            ([640, 480], 420.0, "SIMPLE_RADIAL", &[-0.3], 1),
            ([640, 480], 260.0, "FOV", &[0.9], 5),
            ([640, 480], 250.0, "DIVISION", &[-0.3], 5),
            ([640, 480], 250.0, "EUCM", &[0.4, 1.1], 5),
            (
                [640, 480],
                230.0,
                "THIN_PRISM_FISHEYE",
                &[0.01, 0.0, 0.001, 0.0, 0.0, 0.0, 0.001, 0.0],
                5,
            ),
        ] {
            let camera = camera(size, focal, Some((model, k)));
            let found = of(&camera);
            assert!(found.len() == faces, "{model} {k:?}: {}", found.len());
            let bending = camera.lens.as_ref().unwrap().bending();
            let (mut all, mut missed) = (0, 0);
            for direction in sphere() {
                let seen = camera.rotation * direction;
                let inside = bending.is_none_or(|b| {
                    let [x, y] = b.of_direction(seen.to_array()).unwrap_or([f64::NAN; 2]);
                    let on = |at: f64, edge: u32| (0.0..=f64::from(edge)).contains(&at);
                    // Where the polynomial of the distortion decreases, a photo shows nothing.
                    let turned =
                        model == "SIMPLE_RADIAL" && seen.truncate().length() > 1.05 * seen.z;
                    on(focal * x + camera.cx, size[0])
                        && on(focal * y + camera.cy, size[1])
                        && !turned
                });
                all += usize::from(inside);
                missed += usize::from(inside && !found.iter().any(|c| shows(c, direction)));
            }
            assert!(all > 300 && missed == 0, "{model} {k:?}: {missed} of {all} are not shown");
        }
    }

    #[test]
    fn a_lens_that_shows_no_more_than_its_pinhole_camera_changes_nothing() {
        let plain = camera([640, 480], 500.0, None);
        let less = camera([640, 480], 500.0, Some(("SIMPLE_RADIAL", &[0.05])));
        assert_eq!([of(&plain), of(&less)].concat(), [plain.clone(), plain]);
        let more = of(&camera([640, 480], 500.0, Some(("SIMPLE_RADIAL", &[-0.2]))));
        assert!(more.len() == 1 && more[0].width > 640 && more[0].fx == 500.0, "{more:?}");
    }

    #[test]
    fn faces_are_as_fine_as_the_photo() {
        let panorama = of(&camera([1024, 512], 512.0, Some((PANORAMA, &[]))));
        // Along the equator all pixels are shown once, to rounding and what faces see obliquely.
        assert!(panorama.iter().all(|c| c.width == 326 && c.height == 326), "{panorama:?}");
        let fisheye = of(&camera([600, 600], 170.0, Some(("OPENCV_FISHEYE", &[0.0; 4]))));
        assert!((fisheye[0].fx - 170.0).abs() < 1e-3 && fisheye[0].width == 340, "{fisheye:?}");
    }

    #[test]
    fn evenly_chosen_ones_look_in_all_directions() {
        let cameras = vec![camera([1024, 512], 512.0, Some((PANORAMA, &[]))); 10];
        let all = pinholes(Path::new("-"), &cameras).unwrap();
        assert_eq!(all.len(), 60);
        let mut ahead: Vec<_> = all.iter().step_by(6).map(|c| c.rotation.row(2)).collect();
        ahead.dedup();
        assert_eq!(ahead.len(), 6);
    }

    #[test]
    fn what_no_picture_shows_is_named() {
        let refused = |lens: (&str, &[f64])| {
            let camera = camera([600, 600], 181.0, Some(lens));
            crate::chain(&refuse_wide(Path::new("t.json"), &camera).unwrap_err())
        };
        assert!(refused((PANORAMA, &[])).contains("t.json: view \"a\": a panorama"));
        assert!(refused(("OPENCV_FISHEYE", &[0.0; 4])).contains("degrees to a side"));
        assert!(refused(("ORTHO", &[])).contains("the lens model ORTHO is not known"));
        assert!(pinholes(Path::new("-"), &[camera([6, 6], 1.0, Some(("ORTHO", &[])))]).is_err());
        for usual in [None, Some(("SIMPLE_RADIAL", &[-0.2][..]))] {
            refuse_wide(Path::new("-"), &camera([640, 480], 420.0, usual)).unwrap();
        }
    }

    #[test]
    fn absurd_coefficients_take_little_time_and_memory() {
        for k in [1e300, -1e300, 1e-300, -1e9] {
            for (model, n) in [("FULL_OPENCV", 8), ("OPENCV_FISHEYE", 4), ("FOV", 1), ("EUCM", 2)] {
                let lens = vec![k; n];
                for focal in [1e-9, 1.0, 1e12] {
                    let all = of(&camera([640, 480], focal, Some((model, &lens))));
                    assert!(all.iter().all(Camera::image_fits), "{model} {k} {focal}");
                }
            }
        }
    }
}
