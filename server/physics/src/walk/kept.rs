//! What changes seldom keeps its hash.

use super::hash::hash;
use super::walker::KEPT;
use serde::de::{Deserialize, Deserializer};
use serde::ser::{Serialize, SerializeTupleStruct, Serializer};
use std::ops::{Deref, DerefMut};
use std::sync::OnceLock;

/// A hash that is made when it is first asked for, of what whoever holds it says; forgotten when that changes.
#[derive(Clone, Debug, Default)]
pub struct KeptHash(OnceLock<u64>);

impl KeptHash {
    /// What it is of has changed.
    pub fn forget(&mut self) {
        self.0.take();
    }

    /// The hash with what it is of, `value`.
    pub fn view<T: Serialize>(&self, value: T) -> KeptView<'_, T> {
        KeptView { hash: self, value }
    }
}

/// A hash and what it is of. On a walk that hashes, the hash is walked; on every other, what it is of.
pub struct KeptView<'a, T> {
    hash: &'a KeptHash,
    value: T,
}

/// Walked only when it is to be hashed: elsewhere nobody asks for it.
struct Lazy<'a, T>(&'a KeptView<'a, T>);

impl<T: Serialize> Serialize for Lazy<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let KeptView { hash: kept, value } = self.0;
        serializer.serialize_u64(*kept.0.get_or_init(|| hash(value)))
    }
}

impl<T: Serialize> Serialize for KeptView<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut parts = serializer.serialize_tuple_struct(KEPT, 2)?;
        parts.serialize_field(&Lazy(self))?;
        parts.serialize_field(&self.value)?;
        parts.end()
    }
}

/// A value that keeps its hash until it is borrowed to be changed.
#[derive(Clone, Debug, Default)]
pub struct Kept<T> {
    value: T,
    hash: KeptHash,
}

impl<T: PartialEq> PartialEq for Kept<T> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<T> From<T> for Kept<T> {
    fn from(value: T) -> Self {
        Self { value, hash: KeptHash::default() }
    }
}

impl<T> Deref for Kept<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Kept<T> {
    fn deref_mut(&mut self) -> &mut T {
        self.hash.forget();
        &mut self.value
    }
}

impl<T: Serialize> Serialize for Kept<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.hash.view(&self.value).serialize(serializer)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Kept<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        T::deserialize(deserializer).map(Self::from)
    }
}
