//! The walk itself: a serializer that takes everything apart into numbers.

use super::{Place, Visitor, WalkError};
use serde::ser::{
    Serialize, SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple,
    SerializeTupleStruct, SerializeTupleVariant, Serializer,
};

/// Name by which a walk knows a hash with what it is of.
pub(super) const KEPT: &str = "Kept";

/// Walks `value`.
pub(super) fn walk<V: Visitor>(value: &impl Serialize, visitor: &mut V) {
    value.serialize(Walker(visitor)).expect("plain data is walked to its end");
}

/// Hands what is serialized to a visitor.
struct Walker<'a, V>(&'a mut V);

/// Something of several parts: how many came by so far.
struct Parts<'a, V> {
    visitor: &'a mut V,
    count: usize,
    /// Whether of these two the second is told by the first: a hash, and what it is of.
    kept: bool,
}

impl<'a, V: Visitor> Walker<'a, V> {
    fn number(self, value: u64, bytes: usize) -> Result<(), WalkError> {
        self.0.word(value, bytes);
        Ok(())
    }

    fn bytes(self, bytes: &[u8]) -> Result<(), WalkError> {
        self.0.word(bytes.len() as u64, 8);
        bytes.iter().for_each(|byte| self.0.word(u64::from(*byte), 1));
        Ok(())
    }

    fn parts(self) -> Parts<'a, V> {
        Parts { visitor: self.0, count: 0, kept: false }
    }

    fn variant(self, index: u32) -> Parts<'a, V> {
        self.0.word(u64::from(index), 1);
        self.parts()
    }
}

impl<V: Visitor> Parts<'_, V> {
    #[inline]
    fn part<T: Serialize + ?Sized>(&mut self, place: Place, value: &T) -> Result<(), WalkError> {
        self.count += 1;
        self.visitor.enter(place);
        value.serialize(Walker(self.visitor))?;
        self.visitor.leave();
        Ok(())
    }

    #[inline]
    fn element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        self.part(Place::Element(self.count), value)
    }
}

impl<'a, V: Visitor> Serializer for Walker<'a, V> {
    type Ok = ();
    type Error = WalkError;
    type SerializeSeq = Parts<'a, V>;
    type SerializeTuple = Parts<'a, V>;
    type SerializeTupleStruct = Parts<'a, V>;
    type SerializeTupleVariant = Parts<'a, V>;
    type SerializeMap = Parts<'a, V>;
    type SerializeStruct = Parts<'a, V>;
    type SerializeStructVariant = Parts<'a, V>;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_bool(self, v: bool) -> Result<(), WalkError> {
        self.number(u64::from(v), 1)
    }

    fn serialize_i8(self, v: i8) -> Result<(), WalkError> {
        self.number(u64::from(v as u8), 1)
    }

    fn serialize_i16(self, v: i16) -> Result<(), WalkError> {
        self.number(u64::from(v as u16), 2)
    }

    fn serialize_i32(self, v: i32) -> Result<(), WalkError> {
        self.number(u64::from(v as u32), 4)
    }

    fn serialize_i64(self, v: i64) -> Result<(), WalkError> {
        self.number(v as u64, 8)
    }

    fn serialize_u8(self, v: u8) -> Result<(), WalkError> {
        self.number(u64::from(v), 1)
    }

    fn serialize_u16(self, v: u16) -> Result<(), WalkError> {
        self.number(u64::from(v), 2)
    }

    #[inline]
    fn serialize_u32(self, v: u32) -> Result<(), WalkError> {
        self.number(u64::from(v), 4)
    }

    #[inline]
    fn serialize_u64(self, v: u64) -> Result<(), WalkError> {
        self.number(v, 8)
    }

    #[inline]
    fn serialize_f32(self, v: f32) -> Result<(), WalkError> {
        self.number(u64::from(v.to_bits()), 4)
    }

    #[inline]
    fn serialize_f64(self, v: f64) -> Result<(), WalkError> {
        self.number(v.to_bits(), 8)
    }

    fn serialize_char(self, v: char) -> Result<(), WalkError> {
        self.number(u64::from(u32::from(v)), 4)
    }

    fn serialize_str(self, v: &str) -> Result<(), WalkError> {
        self.bytes(v.as_bytes())
    }

    fn serialize_bytes(self, v: &[u8]) -> Result<(), WalkError> {
        self.bytes(v)
    }

    fn serialize_none(self) -> Result<(), WalkError> {
        self.number(0, 1)
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), WalkError> {
        self.0.word(1, 1);
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), WalkError> {
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<(), WalkError> {
        Ok(())
    }

    fn serialize_unit_variant(self, _: &'static str, index: u32, _: &'static str) -> Result<(), WalkError> {
        self.number(u64::from(index), 1)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Result<(), WalkError> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        index: u32,
        name: &'static str,
        value: &T,
    ) -> Result<(), WalkError> {
        self.variant(index).part(Place::Field(name), value)
    }

    fn serialize_seq(self, len: Option<usize>) -> Result<Parts<'a, V>, WalkError> {
        let len = len.ok_or_else(|| WalkError("a sequence of unknown length".into()))?;
        self.0.word(len as u64, 8);
        Ok(self.parts())
    }

    #[inline]
    fn serialize_tuple(self, _: usize) -> Result<Parts<'a, V>, WalkError> {
        Ok(self.parts())
    }

    fn serialize_tuple_struct(self, name: &'static str, _: usize) -> Result<Parts<'a, V>, WalkError> {
        Ok(Parts { kept: name == KEPT, ..self.parts() })
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Parts<'a, V>, WalkError> {
        Ok(self.variant(index))
    }

    fn serialize_map(self, len: Option<usize>) -> Result<Parts<'a, V>, WalkError> {
        self.serialize_seq(len)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Parts<'a, V>, WalkError> {
        Ok(self.parts())
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Parts<'a, V>, WalkError> {
        Ok(self.variant(index))
    }
}

impl<V: Visitor> SerializeSeq for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    #[inline]
    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        self.element(value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeTuple for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    #[inline]
    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        self.element(value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeTupleStruct for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        let is_hash = self.count == 0;
        if self.kept && is_hash != V::KEPT_BY_HASH {
            self.count += 1;
            return Ok(());
        }
        self.element(value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeTupleVariant for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        self.element(value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeMap for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), WalkError> {
        self.element(key)
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WalkError> {
        self.element(value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeStruct for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    #[inline]
    fn serialize_field<T: Serialize + ?Sized>(&mut self, name: &'static str, value: &T) -> Result<(), WalkError> {
        self.part(Place::Field(name), value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}

impl<V: Visitor> SerializeStructVariant for Parts<'_, V> {
    type Ok = ();
    type Error = WalkError;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, name: &'static str, value: &T) -> Result<(), WalkError> {
        self.part(Place::Field(name), value)
    }

    fn end(self) -> Result<(), WalkError> {
        Ok(())
    }
}
