//! [`Lens`]: how a camera's lens distorts its photo.

/// A lens that distorts: one of COLMAP's camera models with its coefficients (`src/colmap/sensor/models.h`).
///
/// A camera with a lens is read as the pinhole camera that it would be without. Whoever compares a photo with a render
/// undoes the distortion first, with [`Lens::bending`]. [`crate::pinholes`] has the pinhole cameras that show what the
/// photo shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// COLMAP's name of the model; that of another program if COLMAP has no such model.
    pub model: String,
    /// What follows the principal point among the model's parameters.
    pub coefficients: Vec<f64>,
}

/// COLMAP's name of a panorama: all directions, by longitude and latitude.
pub(crate) const PANORAMA: &str = "EQUIRECTANGULAR";

impl Lens {
    /// `None` for coefficients that distort nothing.
    pub(crate) fn new(model: &str, coefficients: &[f64]) -> Option<Self> {
        let lens = Self { model: model.to_owned(), coefficients: coefficients.to_vec() };
        let straight = matches!(lens.bending(), Some(Bending::Polynomial { k, p })
            if k.iter().chain(&p).all(|&v| v == 0.0));
        (!straight).then_some(lens)
    }

    /// The distortion as a function; `None` for a model that is not known here, and for a panorama.
    #[must_use]
    pub fn bending(&self) -> Option<Bending> {
        let (mut k, mut p) = ([0.0; 6], [0.0; 2]);
        match (&self.model[..], &self.coefficients[..]) {
            ("SIMPLE_PINHOLE" | "PINHOLE", []) => {}
            ("SIMPLE_RADIAL", &[k1]) => k[0] = k1,
            ("RADIAL", &[k1, k2]) => (k[0], k[1]) = (k1, k2),
            ("OPENCV", &[k1, k2, p1, p2]) => (k[0], k[1], p) = (k1, k2, [p1, p2]),
            ("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]) => {
                (k, p) = ([k1, k2, k3, k4, k5, k6], [p1, p2]);
            }
            ("SIMPLE_FISHEYE" | "FISHEYE", []) => return Some(Bending::Fisheye([0.0; 4])),
            ("SIMPLE_RADIAL_FISHEYE", &[k1]) => return Some(Bending::Fisheye([k1, 0.0, 0.0, 0.0])),
            ("RADIAL_FISHEYE", &[k1, k2]) => return Some(Bending::Fisheye([k1, k2, 0.0, 0.0])),
            ("OPENCV_FISHEYE", &[k1, k2, k3, k4]) => {
                return Some(Bending::Fisheye([k1, k2, k3, k4]));
            }
            ("THIN_PRISM_FISHEYE", &[k1, k2, p1, p2, k3, k4, sx, sy]) => {
                return Some(Bending::ThinPrism { k: [k1, k2, k3, k4], p: [p1, p2], s: [sx, sy] });
            }
            ("FOV", &[omega]) => return Some(Bending::Fov(omega)),
            ("SIMPLE_DIVISION" | "DIVISION", &[k]) => return Some(Bending::Division(k)),
            ("EUCM", &[alpha, beta]) => return Some(Bending::Unified([alpha, beta])),
            _ => return None,
        }
        Some(Bending::Polynomial { k, p })
    }
}

/// Where light falls that comes from a direction, in focal lengths from the principal point.
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
    /// COLMAP's `THIN_PRISM_FISHEYE`: the angle between light and axis, distorted.
    ThinPrism {
        /// Radial.
        k: [f64; 4],
        /// Tangential.
        p: [f64; 2],
        /// Of the prism.
        s: [f64; 2],
    },
    /// COLMAP's `FOV`, with its angle in radians.
    Fov(f64),
    /// The division model.
    Division(f64),
    /// COLMAP's `EUCM`: alpha and beta of the extended unified model.
    Unified([f64; 2]),
}

impl Bending {
    /// Where light falls that a pinhole camera would see at `(x, y)`, in focal lengths from the principal point.
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
                at_angle([x, y], r, libm::atan(r), k)
            }
            _ => self.of_direction([x, y, 1.0]).unwrap_or([f64::NAN; 2]),
        }
    }

    /// Where light falls from a direction in camera coordinates, which may be behind the camera. `None` where the model
    /// says nothing of it.
    #[must_use]
    pub(crate) fn of_direction(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let r2 = x * x + y * y;
        let r = r2.sqrt();
        let scaled = |factor: f64| Some([x * factor, y * factor]);
        match *self {
            Self::Polynomial { .. } if z > 0.0 => Some(self.apply([x / z, y / z])),
            Self::Fisheye(k) => Some(at_angle([x, y], r, libm::atan2(r, z), k)),
            Self::ThinPrism { k, p, s } => {
                let [x, y] = at_angle([x, y], r, libm::atan2(r, z), [0.0; 4]);
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
                Some([
                    x * radial + 2.0 * p[0] * x * y + p[1] * (r2 + 2.0 * x * x) + s[0] * r2,
                    y * radial + 2.0 * p[1] * x * y + p[0] * (r2 + 2.0 * y * y) + s[1] * r2,
                ])
            }
            Self::Fov(omega) if z > 0.0 => {
                if r < 1e-12 * z || omega.abs() < 1e-9 {
                    return scaled(1.0 / z);
                }
                let slope = 2.0 * libm::tan(0.5 * omega);
                scaled(libm::atan(slope * r / z) / (omega * r))
            }
            Self::Division(k) => {
                let root = z * z - 4.0 * k * r2;
                let under = z + root.sqrt();
                if root >= 0.0 && under > 0.0 { scaled(2.0 / under) } else { None }
            }
            Self::Unified([alpha, beta]) => {
                let under = alpha * (beta * r2 + z * z).sqrt() + (1.0 - alpha) * z;
                if under > 0.0 { scaled(1.0 / under) } else { None }
            }
            Self::Polynomial { .. } | Self::Fov(_) => None,
        }
    }
}

/// Where light falls whose angle to the axis is `angle`; `r` is the length of the direction's part across the axis.
fn at_angle([x, y]: [f64; 2], r: f64, angle: f64, k: [f64; 4]) -> [f64; 2] {
    if r < 1e-12 {
        return [x, y];
    }
    let a2 = angle * angle;
    let bent = angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
    [x * bent / r, y * bent / r]
}
