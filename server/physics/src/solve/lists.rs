//! Lists of one kind of entry, stored one after the other.

use crate::grow::grow;

/// Lists, one after the other: of the rows of a sparse matrix, or of children.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lists<T> {
    first: Vec<u32>,
    entries: Vec<T>,
}

impl<T: Copy + Default> Lists<T> {
    /// Sorts `(list, entry)` pairs into `count` lists; within a list the order stays.
    pub(super) fn fill(&mut self, count: usize, pairs: impl Iterator<Item = (u32, T)> + Clone) {
        self.first.clear();
        grow(&mut self.first, count + 2, 0);
        pairs.clone().for_each(|(list, _)| self.first[list as usize + 2] += 1);
        (2..count + 2).for_each(|i| self.first[i] += self.first[i - 1]);
        self.entries.clear();
        grow(&mut self.entries, self.first[count + 1] as usize, T::default());
        for (list, entry) in pairs {
            let end = &mut self.first[list as usize + 1];
            self.entries[*end as usize] = entry;
            *end += 1;
        }
    }

    #[inline(always)]
    pub(super) fn list(&self, index: usize) -> &[T] {
        &self.entries[self.first[index] as usize..self.first[index + 1] as usize]
    }
}
