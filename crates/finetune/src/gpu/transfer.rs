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
        let stride = sh_end + GEO;
        let part = |rows: &[f32], from: usize, to: usize| -> Vec<f32> {
            rows.chunks_exact(stride).flat_map(|row| &row[from..to]).copied().collect()
        };
        let mut first = 0;
        for (page, n) in self.sizes.pages.iter().enumerate() {
            let rows = first..first + stride * n;
            first = rows.end;
            self.write("means", page, &part(&state[0][rows.clone()], 0, MEAN));
            for (all, (sh, geo)) in state.into_iter().zip(BUFFERS) {
                self.write(sh, page, &part(&all[rows.clone()], MEAN, sh_end));
                self.write(geo, page, &part(&all[rows.clone()], sh_end, stride));
            }
            // What is written waits in memory of the host until something is submitted.
            self.context.queue.submit([]);
        }
    }

    /// The inverse of [`Workspace::upload`]. Moments of the means are zero.
    pub(crate) fn download(&self) -> Result<[Vec<f32>; 3]> {
        let sh_len = 3 * self.sizes.sh_len;
        let mut out = [Vec::new(), Vec::new(), Vec::new()];
        for (page, &n) in self.sizes.pages.iter().enumerate() {
            let means: Vec<f32> = self.read("means", page, MEAN * n)?;
            let still = vec![0.0; MEAN * n];
            for (k, (sh, geo)) in BUFFERS.into_iter().enumerate() {
                let sh: Vec<f32> = self.read(sh, page, sh_len * n)?;
                let geo: Vec<f32> = self.read(geo, page, GEO * n)?;
                let means = if k == 0 { &means } else { &still };
                let others = sh.chunks_exact(sh_len).zip(geo.chunks_exact(GEO));
                for (mean, (sh, geo)) in means.chunks_exact(MEAN).zip(others) {
                    [mean, sh, geo].iter().for_each(|part| out[k].extend_from_slice(part));
                }
            }
        }
        Ok(out)
    }
}
