//! Where a scene is on the globe.

use crate::size;

/// The ellipsoid of WGS 84: its greater half axis in metres, and its flattening.
const RADIUS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// Where the origin of a scene is, with x to the east, y to the north and z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Site {
    /// Radians.
    longitude: f64,
    latitude: f64,
    /// Metres above the ellipsoid.
    height: f64,
}

/// Reads `LON,LAT,HEIGHT`.
pub(crate) fn parse(text: &str) -> Result<Site, String> {
    let usage = "use degrees and metres: LON,LAT,HEIGHT, as in 2.2945,48.8582,35";
    let [longitude, latitude, height] = size::list::<f64, 3>(text, ',').ok_or(usage)?;
    let on_globe = longitude.abs() <= 360.0 && latitude.abs() <= 90.0 && height.abs() <= RADIUS;
    if !on_globe {
        return Err(usage.into());
    }
    Ok(Site { longitude: longitude.to_radians(), latitude: latitude.to_radians(), height })
}

impl Site {
    /// The matrix, column after column, that leads to the axes of the earth.
    pub(super) fn to_earth(self) -> [f64; 16] {
        let [sl, cl] = [libm::sin(self.longitude), libm::cos(self.longitude)];
        let [sp, cp] = [libm::sin(self.latitude), libm::cos(self.latitude)];
        let squared_eccentricity = FLATTENING * (2.0 - FLATTENING);
        let normal = RADIUS / (1.0 - squared_eccentricity * sp * sp).sqrt();
        let [across, along] =
            [normal + self.height, normal * (1.0 - squared_eccentricity) + self.height];
        [
            [-sl, cl, 0.0, 0.0],
            [-sp * cl, -sp * sl, cp, 0.0],
            [cp * cl, cp * sl, sp, 0.0],
            [across * cp * cl, across * cp * sl, along * sp, 1.0],
        ]
        .as_flattened()
        .try_into()
        .unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sites_are_where_the_poles_and_the_equator_are() {
        let near = |text: &str, at: [f64; 3]| {
            let matrix = parse(text).unwrap().to_earth();
            for k in 0..3 {
                assert!((matrix[12 + k] - at[k]).abs() < 1e-3, "{text}: {matrix:?}");
                // Up leads away from the surface.
                assert!((matrix[8 + k] - at[k] / RADIUS).abs() < 4e-3, "{text}: {matrix:?}");
            }
        };
        near("0,0,0", [RADIUS, 0.0, 0.0]);
        near("90,0,100", [0.0, RADIUS + 100.0, 0.0]);
        near("-70,90,0", [0.0, 0.0, 6_356_752.314_245]);
        assert_eq!(
            parse("0,0,0").unwrap().to_earth()[..8],
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        );
        for bad in ["", "1,2", "1,91,0", "1,2,nan", "a,b,c"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
