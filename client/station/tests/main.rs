//! Whole stations.
