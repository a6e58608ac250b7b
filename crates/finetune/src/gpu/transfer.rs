//! Parameters and moments to the device and back, as rows of [`crate::optimiser::SceneOptimiser`].

use super::workspace::Workspace;
use crate::error::Result;

/// Buffers of parameters, first and second moments: of SH coefficients, and of opacity, scales and rotation.
const BUFFERS: [(&str, &str); 3] = [("sh", "geo"), ("sh_m", "geo_m"), ("sh_v", "geo_v")];
/// Floats of a mean, and of opacity, scales and rotation.
const MEAN: usize = 3;
const GEO: usize = 8;

impl Workspace {
    /// Uploads rows of parameters and of the optimiser's moments.
    pub(crate) fn upload(&self, state: [&[f32]; 3]) {
        let sh_end = MEAN + 3 * self.sizes.sh_len;
        let part = |rows: &[f32], from: usize, to: usize| -> Vec<f32> {
            rows.chunks_exact(sh_end + GEO).flat_map(|row| &row[from..to]).copied().collect()
        };
        self.write("means", &part(state[0], 0, MEAN));
        for (rows, (sh, geo)) in state.into_iter().zip(BUFFERS) {
            self.write(sh, &part(rows, MEAN, sh_end));
            self.write(geo, &part(rows, sh_end, sh_end + GEO));
        }
    }

    /// The inverse of [`Workspace::upload`]. Moments of the means are zero.
    pub(crate) fn download(&self) -> Result<[Vec<f32>; 3]> {
        let (n, sh_len) = (self.sizes.count, 3 * self.sizes.sh_len);
        let means: Vec<f32> = self.read("means", MEAN * n)?;
        let still = vec![0.0; MEAN * n];
        let mut out = [Vec::new(), Vec::new(), Vec::new()];
        for (k, (sh, geo)) in BUFFERS.into_iter().enumerate() {
            let sh: Vec<f32> = self.read(sh, sh_len * n)?;
            let geo: Vec<f32> = self.read(geo, GEO * n)?;
            let means = if k == 0 { &means } else { &still };
            let rows =
                means.chunks_exact(MEAN).zip(sh.chunks_exact(sh_len)).zip(geo.chunks_exact(GEO));
            out[k] = rows.flat_map(|((mean, sh), geo)| [mean, sh, geo].concat()).collect();
        }
        Ok(out)
    }
}
