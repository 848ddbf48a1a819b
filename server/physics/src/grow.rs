//! Growth of what is large by element or node, and room for what a step writes.

/// Resizes, with room for an eighth more from the first: parting links adds elements and nodes few at a time. Where room
/// doubled, half of it would stay empty, and the first cut would move all that there is.
pub(crate) fn grow<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    if count > values.capacity() {
        values.reserve_exact(count + count / 8 - values.len());
    }
    values.resize(count, value);
}

/// Makes room for `count` values in all. Of the old room only the values move. `Vec::reserve` moves all of it, and so
/// writes pages that nothing was ever written to: milliseconds for the springs of a body that is cut for the first time.
pub(crate) fn make_room<T>(values: &mut Vec<T>, count: usize) {
    if count > values.capacity() {
        let mut roomy = Vec::with_capacity(count.max(2 * values.capacity()));
        roomy.append(values);
        *values = roomy;
    }
}
