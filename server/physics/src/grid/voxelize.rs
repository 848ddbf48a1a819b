//! From a scene's shapes to voxels, links and signed distances.
