//! Parameters and moments to the device and back.

use gs_model::Scene;

use super::workspace::Workspace;
use crate::error::Result;
use crate::stages::adam::Moments;

impl Workspace {
    /// Uploads a scene and the optimiser's moments.
    pub(crate) fn upload(&self, scene: &Scene, moments: &Moments) {
        self.write("means", scene.means.as_flattened());
        self.write("sh", scene.sh.as_flattened());
        let [sh_m, sh_v] = &moments.sh;
        self.write("sh_m", sh_m);
        self.write("sh_v", sh_v);
        let geo = |o: &[f32], l: &[f32], q: &[f32]| -> Vec<f32> {
            let mut out = Vec::with_capacity(8 * o.len());
            for ((o, l), q) in o.iter().zip(l.chunks_exact(3)).zip(q.chunks_exact(4)) {
                out.push(*o);
                out.extend_from_slice(l);
                out.extend_from_slice(q);
            }
            out
        };
        let (l, q) = (scene.log_scales.as_flattened(), scene.rotations.as_flattened());
        self.write("geo", &geo(&scene.opacity_logits, l, q));
        for (k, name) in ["geo_m", "geo_v"].into_iter().enumerate() {
            let m = moments;
            self.write(name, &geo(&m.opacity[k], &m.log_scale[k], &m.rotation[k]));
        }
    }

    /// The inverse of [`Workspace::upload`], but for the means and the degree, which stay.
    pub(crate) fn download(&self, scene: &mut Scene, moments: &mut Moments) -> Result<()> {
        let n = self.sizes.count;
        let split = |geo: &[f32], o: &mut [f32], l: &mut [f32], q: &mut [f32]| {
            let geo = geo.chunks_exact(8);
            for (((g, o), l), q) in geo.zip(o).zip(l.chunks_exact_mut(3)).zip(q.chunks_exact_mut(4))
            {
                *o = g[0];
                l.copy_from_slice(&g[1..4]);
                q.copy_from_slice(&g[4..8]);
            }
        };
        let (l, q) = (scene.log_scales.as_flattened_mut(), scene.rotations.as_flattened_mut());
        split(&self.read("geo", 8 * n)?, &mut scene.opacity_logits, l, q);
        for (k, name) in ["geo_m", "geo_v"].into_iter().enumerate() {
            let m = &mut *moments;
            let geo = self.read::<f32>(name, 8 * n)?;
            split(&geo, &mut m.opacity[k], &mut m.log_scale[k], &mut m.rotation[k]);
        }
        let words = 3 * self.sizes.sh_len * n;
        scene.sh.as_flattened_mut().copy_from_slice(&self.read::<f32>("sh", words)?);
        moments.sh = [self.read("sh_m", words)?, self.read("sh_v", words)?];
        Ok(())
    }
}
