//! What of a cycle follows the state with a lag: made when it was worth it, of a state that has gone on since. It is no
//! function of the state of now, and so a part of it; all else of a cycle is made anew.

use super::assembly::LANES;
use super::cycle_level::CycleLevel;
use super::diagonal::Diagonal;
use super::operator::OperatorBlock;
use crate::fem::packed::PackedMatrix;
use crate::grid::levels::Level;
use crate::walk::{Kept, KeptView, WalkError};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use wide::f32x8;

/// Of one level.
#[derive(Serialize, Deserialize)]
struct Lag<D, M> {
    largest_eigenvalue: f32,
    /// Of the elements' matrices, as they were turned when it was made.
    diagonal: D,
    /// Of blocks of elements; absent on the finest level, where they follow the state without a lag.
    matrices: Option<M>,
}

/// The matrices of blocks as they stand.
struct Matrices<'a>(&'a [OperatorBlock]);

impl Serialize for Matrices<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|block| &block.matrix))
    }
}

/// Walks what lags of the levels, the finest first.
pub(super) fn serialize<S: Serializer>(levels: &[CycleLevel], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(levels.iter().enumerate().map(|(index, level)| {
        let operator = &level.operator;
        let matrices: KeptView<'_, Matrices<'_>> = operator.matrices_hash().view(Matrices(&operator.blocks));
        Lag {
            largest_eigenvalue: level.largest_eigenvalue,
            diagonal: operator.diagonal(),
            matrices: (index > 0).then_some(matrices),
        }
    }))
}

/// Levels that have what lags and nothing else, to be completed by [`complete`].
pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<CycleLevel>, D::Error> {
    type Read = Lag<Kept<Diagonal>, Vec<PackedMatrix<f32x8>>>;
    let levels = Vec::<Read>::deserialize(deserializer)?;
    Ok(levels.into_iter().map(|lag| CycleLevel::lagging(lag.largest_eigenvalue, lag.diagonal, lag.matrices)).collect())
}

/// Gives what lags to levels that were made anew.
pub(super) fn complete(read: Vec<CycleLevel>, fresh: &mut [CycleLevel], hierarchy: &[Level]) -> Result<(), WalkError> {
    if read.len() != fresh.len() {
        return Err(WalkError::new(format!("{} levels of a cycle over {}", read.len(), fresh.len())));
    }
    for (index, (read, fresh)) in read.into_iter().zip(fresh).enumerate() {
        let blocks = if index == 0 { 0 } else { hierarchy[index].elements.len().div_ceil(LANES) };
        if read.operator.blocks.len() != blocks || read.operator.diagonal().len() != fresh.operator.node_count() {
            return Err(WalkError::new(format!("level {index} of a cycle is not as large as its elements")));
        }
        fresh.take_lag(read);
    }
    Ok(())
}
