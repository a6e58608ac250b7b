//! Where the meshes of a scene are: its nodes, from the roots on.

use super::json::Root;
use crate::axes::Placement;

/// A mesh in the scene.
pub(super) struct Instance {
    pub(super) mesh: usize,
    /// The node that has it; none in a file without nodes.
    pub(super) node: Option<usize>,
    /// From the axes of the mesh to those of the scene.
    pub(super) placement: Placement,
}

/// A node, and what is wrong with it.
pub(super) type Fault = (usize, String);

/// The meshes with Gaussians in the scene, in the order of its nodes. Where the scene has none, those of all nodes;
/// where these have none, every mesh as it is.
pub(super) fn instances(root: &Root) -> Result<Vec<Instance>, Fault> {
    let mut is_root = vec![true; root.nodes.len()];
    for &child in root.nodes.iter().flat_map(|node| &node.children) {
        is_root.get_mut(child).into_iter().for_each(|is| *is = false);
    }
    let all: Vec<usize> = (0..root.nodes.len()).filter(|&node| is_root[node]).collect();
    let scene = root.scenes.get(root.scene).map_or(&all, |scene| &scene.nodes);
    for roots in [scene, &all] {
        let found = below(root, roots)?;
        if !found.is_empty() {
            return Ok(found);
        }
    }
    let meshes = (0..root.meshes.len()).filter(|&mesh| root.has_splats(mesh));
    let placement = Placement::STAYING;
    Ok(meshes.map(|mesh| Instance { mesh, node: None, placement }).collect())
}

/// The meshes with Gaussians of these nodes and of all below them.
fn below(root: &Root, roots: &[usize]) -> Result<Vec<Instance>, Fault> {
    let mut found = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    let mut open: Vec<(usize, Placement)> =
        roots.iter().rev().map(|&at| (at, Placement::STAYING)).collect();
    while let Some((at, parent)) = open.pop() {
        let node = root.nodes.get(at).ok_or_else(|| (at, "it is not there".into()))?;
        if std::mem::replace(&mut seen[at], true) {
            return Err((at, "it is below two nodes, or below itself".into()));
        }
        let own = node.placement().ok_or_else(|| (at, "its matrix is a projection".into()))?;
        let placement = parent.after(&own);
        if let Some(mesh) = node.mesh.filter(|&mesh| root.has_splats(mesh)) {
            if let Some(name) = node.extensions.keys().next() {
                return Err((at, format!("it has {name}, which is not read")));
            }
            found.push(Instance { mesh, node: Some(at), placement });
        }
        open.extend(node.children.iter().rev().map(|&child| (child, placement)));
    }
    Ok(found)
}
