//! Displacements as differences to a reference, which is renewed as soon as that pays.

use kerf_proto::integers;
use prost::bytes::Bytes;

/// Writes displacements; keeps the reference.
#[derive(Default)]
pub struct Differences {
    reference: Option<Reference>,
}

struct Reference {
    step: u64,
    /// Per object.
    quanta: Vec<Vec<i32>>,
    bytes: Vec<Bytes>,
    /// States written with it, and the bytes of it and all of them.
    states: usize,
    total_bytes: usize,
}

/// Displacements of one state.
pub struct Coded {
    /// Step of the reference.
    pub reference_step: u64,
    /// The reference, per object.
    pub reference: Vec<Bytes>,
    /// What the displacements are above it, per object.
    pub differences: Vec<Bytes>,
}

impl Differences {
    /// Forgets the reference: slots mean something else from now on.
    pub fn start_over(&mut self) {
        self.reference = None;
    }

    /// Writes the displacements after `step`, in quanta per object.
    ///
    /// They become the reference themselves where the differences to the old one would take more bytes than a state has
    /// taken since it was renewed, itself included: from then on each further state would raise the mean.
    pub fn encode(&mut self, step: u64, quanta: Vec<Vec<i32>>) -> Coded {
        if let Some(reference) = &mut self.reference {
            let differences = encode_above(&quanta, &reference.quanta);
            let bytes = total_bytes(&differences);
            if bytes * reference.states <= reference.total_bytes {
                reference.states += 1;
                reference.total_bytes += bytes;
                return Coded { reference_step: reference.step, reference: reference.bytes.clone(), differences };
            }
        }
        let bytes = encode_above(&quanta, &[]);
        let differences = encode_above(&quanta, &quanta);
        let total_bytes = total_bytes(&bytes) + total_bytes(&differences);
        self.reference = Some(Reference { step, quanta, bytes: bytes.clone(), states: 1, total_bytes });
        Coded { reference_step: step, reference: bytes, differences }
    }
}

fn total_bytes(objects: &[Bytes]) -> usize {
    objects.iter().map(Bytes::len).sum()
}

/// What is missing in the reference is 0 there.
fn encode_above(quanta: &[Vec<i32>], reference: &[Vec<i32>]) -> Vec<Bytes> {
    let object = |(index, now): (usize, &Vec<i32>)| {
        let then = reference.get(index).map_or(&[][..], Vec::as_slice);
        let (old, new) = now.split_at(then.len().min(now.len()));
        let changed = old.iter().zip(then).map(|(now, then)| i64::from(*now) - i64::from(*then));
        integers::encode(changed.chain(new.iter().copied().map(i64::from))).into()
    };
    quanta.iter().enumerate().map(object).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a viewer makes of it.
    fn decode(coded: &Coded, slots: usize) -> Vec<i64> {
        let mut reference = integers::decode(&coded.reference[0], slots).unwrap();
        reference.resize(slots, 0);
        let differences = integers::decode_exactly(&coded.differences[0], slots).unwrap();
        differences.iter().zip(reference).map(|(difference, reference)| difference + reference).collect()
    }

    #[test]
    fn every_state_comes_back_also_as_slots_are_added() {
        let mut differences = Differences::default();
        for step in 0..50 {
            let slots = 30 + step as usize;
            let now: Vec<i32> = (0..slots as i32).map(|i| (i * i - 7 * i) * step as i32 / 9).collect();
            let coded = differences.encode(step, vec![now.clone()]);
            assert!(coded.reference_step <= step);
            assert_eq!(decode(&coded, slots), now.into_iter().map(i64::from).collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_stands_keeps_its_reference_and_what_moves_renews_it_now_and_then() {
        let mut differences = Differences::default();
        let mut references = |speed: i32| {
            let state = |step: u64| vec![(0..3000).map(|i| i + speed * step as i32 * (i % 7)).collect()];
            let mut steps: Vec<u64> =
                (0..120).map(|step| differences.encode(step, state(step)).reference_step).collect();
            steps.dedup();
            differences.start_over();
            steps.len()
        };
        assert_eq!(references(0), 1);
        assert!((3..60).contains(&references(20)), "{}", references(20));
    }
}
