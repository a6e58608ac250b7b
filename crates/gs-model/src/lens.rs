//! [`Lens`]: how a camera's lens distorts its photo.

/// A lens that distorts: one of COLMAP's camera models with its coefficients (`src/colmap/sensor/models.h`).
///
/// A camera with a lens is read as the pinhole camera that it would be without. Whoever compares a photo with a render
/// undoes the distortion first, with [`Lens::bending`].
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// COLMAP's name of the model; that of another program if COLMAP has no such model.
    pub model: String,
    /// What follows the principal point among the model's parameters.
    pub coefficients: Vec<f64>,
}

impl Lens {
    /// `None` for coefficients that distort nothing.
    pub(crate) fn new(model: &str, coefficients: &[f64]) -> Option<Self> {
        let lens = Self { model: model.to_owned(), coefficients: coefficients.to_vec() };
        let straight = matches!(lens.bending(), Some(Bending::Polynomial { k, p })
            if k.iter().chain(&p).all(|&v| v == 0.0));
        (!straight).then_some(lens)
    }

    /// The distortion as a function; `None` for a model that is not known here.
    #[must_use]
    pub fn bending(&self) -> Option<Bending> {
        let (mut k, mut p) = ([0.0; 6], [0.0; 2]);
        match (&self.model[..], &self.coefficients[..]) {
            ("SIMPLE_RADIAL", &[k1]) => k[0] = k1,
            ("RADIAL", &[k1, k2]) => (k[0], k[1]) = (k1, k2),
            ("OPENCV", &[k1, k2, p1, p2]) => (k[0], k[1], p) = (k1, k2, [p1, p2]),
            ("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]) => {
                (k, p) = ([k1, k2, k3, k4, k5, k6], [p1, p2]);
            }
            ("SIMPLE_RADIAL_FISHEYE", &[k1]) => return Some(Bending::Fisheye([k1, 0.0, 0.0, 0.0])),
            ("RADIAL_FISHEYE", &[k1, k2]) => return Some(Bending::Fisheye([k1, k2, 0.0, 0.0])),
            ("OPENCV_FISHEYE", &[k1, k2, k3, k4]) => {
                return Some(Bending::Fisheye([k1, k2, k3, k4]));
            }
            _ => return None,
        }
        Some(Bending::Polynomial { k, p })
    }
}

/// Where light falls that a pinhole camera would see at `(x, y)`, both in focal lengths from the principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bending {
    /// OpenCV's model: radial coefficients `k1` to `k6`, a quotient of two polynomials, and tangential ones.
    Polynomial {
        /// Of `(1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)`.
        k: [f64; 6],
        /// Tangential.
        p: [f64; 2],
    },
    /// OpenCV's fisheye: a polynomial of the angle between light and axis.
    Fisheye([f64; 4]),
}

impl Bending {
    /// The bent point.
    #[must_use]
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let r2 = x * x + y * y;
        match *self {
            Self::Polynomial { k, p } => {
                let over = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
                let under = 1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]));
                let radial = over / under;
                [
                    x * radial + 2.0 * p[0] * x * y + p[1] * (r2 + 2.0 * x * x),
                    y * radial + 2.0 * p[1] * x * y + p[0] * (r2 + 2.0 * y * y),
                ]
            }
            Self::Fisheye(k) => {
                let r = r2.sqrt();
                if r < 1e-12 {
                    return [x, y];
                }
                let angle = libm::atan(r);
                let a2 = angle * angle;
                let bent = angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
                [x * bent / r, y * bent / r]
            }
        }
    }
}
