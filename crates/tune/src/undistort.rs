//! Photos as a pinhole camera would take them.

use finetune::Photo;
use gs_model::Camera;
use gs_model::lens::{Bending, Lens};
use rayon::prelude::*;

/// Least and greatest zoom of the pinhole camera over the camera with the lens. The search halves the range so often.
const ZOOM: [f64; 2] = [0.5, 4.0];
const HALVINGS: usize = 20;
/// Points along an edge of the photo, and along the way from the principal point to each.
const ALONG_EDGE: u32 = 64;
const ALONG_WAY: u32 = 16;

/// Undoes what a lens does to a photo of its camera's size. The camera sees as much as it can without a pixel that the
/// photo does not show, so its focal lengths differ; nothing else does.
///
/// # Errors
/// Why it cannot be done.
pub(crate) fn undistorted(camera: Camera, photo: Photo) -> Result<(Camera, Photo), String> {
    let Some(lens) = &camera.lens else { return Ok((camera, photo)) };
    if let Some(reason) = gs_model::too_wide(&camera) {
        return Err(reason);
    }
    let zoomed = lens.bending().and_then(|bending| Some((bending, zoom(&camera, &bending)?)));
    let Some((bending, zoom)) = zoomed else {
        let Lens { model, .. } = lens;
        return Err(format!(
            "the lens ({model}) distorts more than a pinhole camera can show: undistort the photos with \
             `colmap image_undistorter`"
        ));
    };
    let straight =
        Camera { lens: None, fx: camera.fx * zoom, fy: camera.fy * zoom, ..camera.clone() };
    let row = |y: u32| {
        let at = |x: u32| [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let pixel = |x: u32| sampled(&photo, in_photo(&camera, &bending, &straight, at(x)));
        (0..photo.width).flat_map(pixel).collect::<Vec<u8>>()
    };
    let rgb = (0..photo.height).into_par_iter().flat_map_iter(row).collect();
    let photo = Photo { rgb, ..photo };
    Ok((straight, photo))
}

/// Where in the photo of `camera` lies what `straight` sees at a point, in pixels.
fn in_photo(camera: &Camera, bending: &Bending, straight: &Camera, [x, y]: [f64; 2]) -> [f64; 2] {
    let seen = [(x - straight.cx) / straight.fx, (y - straight.cy) / straight.fy];
    let [x, y] = bending.apply(seen);
    [camera.fx * x + camera.cx, camera.fy * y + camera.cy]
}

/// The least zoom at which the photo shows all that the pinhole camera sees.
fn zoom(camera: &Camera, bending: &Bending) -> Option<f64> {
    let fits = |zoom: f64| {
        let straight = Camera { fx: camera.fx * zoom, fy: camera.fy * zoom, ..camera.clone() };
        border(camera).all(|point| way_is_in(camera, bending, &straight, point))
    };
    let [mut least, mut most] = ZOOM;
    if fits(least) {
        return Some(least);
    }
    if !fits(most) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = (least * most).sqrt();
        if fits(middle) { most = middle } else { least = middle }
    }
    Some(most)
}

/// Points on the edges of the image.
fn border(camera: &Camera) -> impl Iterator<Item = [f64; 2]> + use<> {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let sides = move |t: f64| [[t * w, 0.0], [t * w, h], [0.0, t * h], [w, t * h]];
    (0..=ALONG_EDGE).flat_map(move |i| sides(f64::from(i) / f64::from(ALONG_EDGE)))
}

/// Whether the way from the principal point to a point goes outwards in the photo all along, and ends in it. Beyond the
/// angles that a lens was measured for, its polynomial may turn back.
fn way_is_in(camera: &Camera, bending: &Bending, straight: &Camera, end: [f64; 2]) -> bool {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let mut last = -1.0;
    for i in 1..=ALONG_WAY {
        let t = f64::from(i) / f64::from(ALONG_WAY);
        let way = [camera.cx + t * (end[0] - camera.cx), camera.cy + t * (end[1] - camera.cy)];
        let [x, y] = in_photo(camera, bending, straight, way);
        let (dx, dy) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
        let away = dx * dx + dy * dy;
        let inside = (0.0..=w).contains(&x) && (0.0..=h).contains(&y);
        if !(inside && away >= last) {
            return false;
        }
        last = away;
    }
    true
}

/// The photo's colour at a point, linear between the centres of pixels.
fn sampled(photo: &Photo, [x, y]: [f64; 2]) -> [u8; 3] {
    let axis = |at: f64, size: u32| {
        let at = (at - 0.5).clamp(0.0, f64::from(size - 1));
        let low = at as usize;
        (low, (low + 1).min(size as usize - 1), at - low as f64)
    };
    let (left, right, tx) = axis(x, photo.width);
    let (top, bottom, ty) = axis(y, photo.height);
    [0, 1, 2].map(|channel| {
        let value =
            |x: usize, y: usize| f64::from(photo.rgb[3 * (y * photo.width as usize + x) + channel]);
        let row = |y: usize| value(left, y) * (1.0 - tx) + value(right, y) * tx;
        (row(top) * (1.0 - ty) + row(bottom) * ty + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// What lies in a direction.
    fn scene([x, y]: [f64; 2]) -> [u8; 3] {
        [3.0, 4.0, 5.0].map(|f| (127.5 + 100.0 * libm::sin(f * x + 1.0) * libm::cos(f * y)) as u8)
    }

    /// The point that is bent to `bent`, by a search that approaches it.
    fn unbent(bending: &Bending, bent: [f64; 2]) -> [f64; 2] {
        (0..200).fold(bent, |at, _| {
            let found = bending.apply(at);
            [0, 1].map(|i| at[i] + 0.7 * (bent[i] - found[i]))
        })
    }

    fn camera(lens: Lens) -> Camera {
        let eye = [0.0, 0.0, -1.0];
        let size = [160, 120];
        let mut out = Camera::looking_at(
            "a".into(),
            eye,
            DVec3::ZERO.to_array(),
            [0.0, -1.0, 0.0],
            size,
            120.0,
        );
        (out.fy, out.cx, out.lens) = (118.0, 83.0, Some(lens));
        out
    }

    #[test]
    fn photos_become_those_of_a_pinhole_camera() {
        for (model, coefficients) in [
            ("SIMPLE_RADIAL", &[-0.15][..]),
            ("RADIAL", &[0.1, 0.05]),
            ("OPENCV", &[-0.2, 0.05, 0.004, -0.003]),
            ("FULL_OPENCV", &[0.1, 0.02, 0.001, 0.002, 0.01, 0.2, 0.01, 0.0]),
            ("OPENCV_FISHEYE", &[0.05, -0.01, 0.002, 0.0]),
            ("RADIAL_FISHEYE", &[-0.02, 0.01]),
            ("FOV", &[0.5]),
            ("THIN_PRISM_FISHEYE", &[0.02, 0.0, 0.002, 0.001, 0.0, 0.0, 0.002, 0.001]),
        ] {
            let lens = Lens { model: model.into(), coefficients: coefficients.to_vec() };
            let bending = lens.bending().unwrap();
            let camera = camera(lens);
            let mut photo = Photo::black(camera.width, camera.height);
            let places = |c: &Camera| (0..c.height).flat_map(|y| (0..160).map(move |x| [x, y]));
            let centred = |c: &Camera, [x, y]: [u32; 2]| {
                [(f64::from(x) + 0.5 - c.cx) / c.fx, (f64::from(y) + 0.5 - c.cy) / c.fy]
            };
            for (pixel, at) in photo.rgb.chunks_mut(3).zip(places(&camera)) {
                pixel.copy_from_slice(&scene(unbent(&bending, centred(&camera, at))));
            }
            let (straight, found) = undistorted(camera, photo).unwrap();
            assert_eq!((straight.lens.clone(), found.rgb.len()), (None, 3 * 160 * 120));
            let ratio = straight.fx / 120.0;
            assert!((0.5..1.5).contains(&ratio) && ratio != 1.0, "{model}: {ratio}");
            for (pixel, at) in found.rgb.chunks(3).zip(places(&straight)) {
                let want = scene(centred(&straight, at));
                let most = pixel.iter().zip(want).map(|(a, b)| a.abs_diff(b)).max().unwrap();
                assert!(most <= 3, "{model} at {at:?}: {pixel:?}, not {want:?}");
            }
        }
    }

    #[test]
    fn lenses_that_cannot_be_undone_are_named() {
        let of = |model: &str, coefficients: &[f64]| {
            let lens = Lens { model: model.into(), coefficients: coefficients.to_vec() };
            undistorted(camera(lens), Photo::black(160, 120)).unwrap_err()
        };
        assert!(of("ORTHO", &[0.9]).contains("ORTHO is not known"));
        assert!(of("EQUIRECTANGULAR", &[]).contains("a panorama"));
        for k in [-1e6, f64::NAN, f64::INFINITY] {
            assert!(of("SIMPLE_RADIAL", &[k]).contains("SIMPLE_RADIAL) distorts more"));
        }
    }
}
