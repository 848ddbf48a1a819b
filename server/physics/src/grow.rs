//! Growth of what is large by element or node.

/// Resizes, with room for an eighth more from the first: parting links adds elements and nodes few at a time. Where room
/// doubled, half of it would stay empty, and the first cut would move all that there is.
pub(crate) fn grow<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    if count > values.capacity() {
        values.reserve_exact(count + count / 8 - values.len());
    }
    values.resize(count, value);
}
