//! Sets of numbers below a bound, a bit each, that number their members.

/// Numbers that share a word.
const WORD: usize = u32::BITS as usize;

/// A set of numbers, and the place of each among them, in ascending order.
#[derive(Clone, Debug, Default)]
pub(super) struct RankedSet(Vec<RankedWord>);

#[derive(Clone, Copy, Debug, Default)]
struct RankedWord {
    members: u32,
    /// How many members come before this word.
    before: u32,
}

impl RankedSet {
    /// `members` ascending and below `bound`.
    pub(super) fn new(bound: usize, members: impl Iterator<Item = usize>) -> Self {
        let mut words = vec![RankedWord::default(); bound.div_ceil(WORD)];
        members.for_each(|member| words[member / WORD].members |= 1 << (member % WORD));
        let mut before = 0;
        for word in &mut words {
            word.before = before;
            before += word.members.count_ones();
        }
        Self(words)
    }

    /// How many members are smaller than this one.
    pub(super) fn rank(&self, number: usize) -> Option<u32> {
        let RankedWord { members, before } = self.0[number / WORD];
        let bit = 1 << (number % WORD);
        (members & bit != 0).then(|| before + (members & (bit - 1)).count_ones())
    }

    pub(super) fn contains(&self, number: usize) -> bool {
        self.0[number / WORD].members & 1 << (number % WORD) != 0
    }
}
