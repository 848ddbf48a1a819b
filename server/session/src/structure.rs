//! The structure of a scene, put together from a keyframe and the patches after it.

use kerf_physics::surface::delta::{BodyStructure, Keyframe, TopologyPatch};

/// Applies a patch to the keyframe that it is of. `false`, and nothing is changed, where it is of another version.
pub fn apply_patch(keyframe: &mut Keyframe, patch: &TopologyPatch) -> bool {
    if patch.from_version != keyframe.topology_version || patch.bodies.len() != keyframe.bodies.len() {
        return false;
    }
    keyframe.bodies.iter_mut().zip(&patch.bodies).for_each(|(body, change)| apply(body, change));
    keyframe.topology_version = patch.to_version;
    keyframe.surface_hash = patch.surface_hash;
    true
}

fn apply(body: &mut BodyStructure, change: &BodyStructure) {
    merge(&mut body.nodes, &change.nodes, |node| node.id.into());
    merge(&mut body.elements, &change.elements, |element| element.id.into());
    merge(&mut body.vertices, &change.vertices, |vertex| vertex.id.into());
    merge(&mut body.quads, &change.quads, |quad| quad.id.into());
    body.node_count = change.node_count;
}

/// Replaces and adds entries; both lists ascend by id.
fn merge<T: Clone>(entries: &mut Vec<T>, changes: &[T], id: impl Fn(&T) -> u64) {
    if changes.is_empty() {
        return;
    }
    let mut merged = Vec::with_capacity(entries.len() + changes.len());
    let mut rest = entries.as_slice();
    for change in changes {
        let (before, from) = rest.split_at(rest.partition_point(|entry| id(entry) < id(change)));
        merged.extend_from_slice(before);
        merged.push(change.clone());
        rest = &from[from.partition_point(|entry| id(entry) == id(change))..];
    }
    merged.extend_from_slice(rest);
    *entries = merged;
}

#[cfg(test)]
mod tests {
    use super::merge;

    #[test]
    fn changes_replace_and_add_by_id() {
        let mut entries = vec![(1, 'a'), (3, 'a'), (5, 'a')];
        merge(&mut entries, &[(0, 'b'), (3, 'b'), (4, 'b'), (9, 'b')], |(id, _)| *id);
        assert_eq!(entries, [(0, 'b'), (1, 'a'), (3, 'b'), (4, 'b'), (5, 'a'), (9, 'b')]);
    }
}
