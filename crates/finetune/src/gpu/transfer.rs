//! Parameters and moments to the device and back, as rows of [`crate::optimiser::SceneOptimiser`].

use super::workspace::Workspace;
use crate::error::Result;
use crate::shaders::GEO;

/// Buffers of parameters, first and second moments: of SH coefficients, and of opacity, scales, rotation and mean.
const BUFFERS: [(&str, &str); 3] = [("sh", "geo"), ("sh_m", "geo_m"), ("sh_v", "geo_v")];
/// Floats of a mean.
const MEAN: usize = 3;
const STRIDE: usize = GEO as usize;

impl Workspace {
    /// Uploads rows of parameters, and of the optimiser's moments if there are any.
    pub(crate) fn upload(&self, state: &[&[f32]]) {
        let sh_end = MEAN + 3 * self.sizes.sh_len;
        let stride = sh_end + STRIDE - MEAN;
        let mut first = 0;
        for (page, n) in self.sizes.pages.iter().enumerate() {
            let rows = first..first + stride * n;
            first = rows.end;
            for (all, (sh, geo)) in state.iter().zip(BUFFERS) {
                let rows = || all[rows.clone()].chunks_exact(stride);
                let values: Vec<f32> = rows().flat_map(|row| &row[MEAN..sh_end]).copied().collect();
                self.write(sh, page, &values);
                let values = rows().flat_map(|row| row[sh_end..].iter().chain(&row[..MEAN]));
                self.write(geo, page, &values.copied().collect::<Vec<_>>());
            }
            // What is written waits in memory of the host until something is submitted.
            self.context.queue.submit([]);
        }
    }

    /// The inverse of [`Workspace::upload`]: the rows of the parameters (0), of the first (1), or of the second moments (2).
    pub(crate) fn download(&self, which: usize) -> Result<Vec<f32>> {
        let (sh, geo) = BUFFERS[which];
        let sh_len = 3 * self.sizes.sh_len;
        let mut out = Vec::with_capacity((sh_len + STRIDE) * self.sizes.count());
        for (page, &n) in self.sizes.pages.iter().enumerate() {
            let sh: Vec<f32> = self.read(sh, page, sh_len * n)?;
            let geo: Vec<f32> = self.read(geo, page, STRIDE * n)?;
            for (sh, geo) in sh.chunks_exact(sh_len).zip(geo.chunks_exact(STRIDE)) {
                let (geo, mean) = geo.split_at(STRIDE - MEAN);
                [mean, sh, geo].iter().for_each(|part| out.extend_from_slice(part));
            }
        }
        Ok(out)
    }
}
