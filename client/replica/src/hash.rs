//! The surface hash, as `kerf/v1/view.proto` specifies it.

/// Accumulates 64-bit words.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHasher(u64);

impl Default for SurfaceHasher {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl SurfaceHasher {
    /// Folds in one word.
    pub fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    }

    /// The hash of everything folded in so far.
    #[must_use]
    pub fn finish(&self) -> u64 {
        let mixed = (self.0 ^ (self.0 >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 29)
    }
}
