//! A vertex of a surface.

/// What a surface vertex moves with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vertex {
    /// An element.
    Bound {
        /// Its id.
        element: u32,
        /// Trilinear coordinates in the element; corner `c` is at `(c & 1, c >> 1 & 1, c >> 2)`.
        local: [f32; 3],
        /// Material of its voxel, an index into the object's names of materials.
        material: u32,
    },
    /// The node whose id is its own: surfaces come as plain vertices.
    Node,
}

impl Vertex {
    /// Material of its voxel, an index into the object's names of materials. Plain vertices do not tell: 0, the object's
    /// own.
    #[must_use]
    pub fn material(self) -> u32 {
        match self {
            Self::Bound { material, .. } => material,
            Self::Node => 0,
        }
    }

    /// Its element and its place there, of one that is bound.
    #[must_use]
    pub fn binding(self) -> Option<(u32, [f32; 3])> {
        match self {
            Self::Bound { element, local, .. } => Some((element, local)),
            Self::Node => None,
        }
    }
}
