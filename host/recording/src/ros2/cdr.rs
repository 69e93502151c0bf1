//! CDR, the bytes of ROS 2's messages: little-endian, each number at a multiple of its size from the beginning of the body,
//! strings and sequences behind their number of elements, strings with a zero at their end. Pure.

use std::fmt;

use serde::ser::{
    Impossible, Serialize, SerializeSeq, SerializeStruct, SerializeTuple, SerializeTupleStruct, Serializer,
};

/// Before the body: plain CDR, little-endian.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A value without a CDR encoding.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found {0}, expected numbers, strings, sequences or structures of them")]
pub struct CdrError(String);

impl serde::ser::Error for CdrError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

/// A message with the header that says how it is written.
///
/// # Errors
/// [`CdrError`] for what no message has: options, maps, enumerations with data.
pub fn to_cdr(message: &impl Serialize) -> Result<Vec<u8>, CdrError> {
    let mut cdr = Cdr {
        bytes: HEADER.to_vec(),
    };
    message.serialize(&mut cdr)?;
    Ok(cdr.bytes)
}

struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    /// A number, padded to a multiple of its size.
    fn number<const SIZE: usize>(&mut self, number: [u8; SIZE]) {
        let body = self.bytes.len() - HEADER.len();
        let at = HEADER.len() + body.next_multiple_of(SIZE);
        self.bytes.resize(at, 0);
        self.bytes.extend(number);
    }

    fn length(&mut self, length: usize) -> Result<(), CdrError> {
        let length =
            u32::try_from(length).map_err(|_| CdrError(format!("a sequence of {length} elements")))?;
        self.number(length.to_le_bytes());
        Ok(())
    }
}

fn unknown<T>(what: &str) -> Result<T, CdrError> {
    Err(CdrError(what.to_owned()))
}

macro_rules! numbers {
    ($($name:ident: $number:ty),*) => {$(
        fn $name(self, number: $number) -> Result<(), CdrError> {
            self.number(number.to_le_bytes());
            Ok(())
        }
    )*};
}

impl<'a> Serializer for &'a mut Cdr {
    type Ok = ();
    type Error = CdrError;
    type SerializeSeq = &'a mut Cdr;
    type SerializeTuple = &'a mut Cdr;
    type SerializeTupleStruct = &'a mut Cdr;
    type SerializeTupleVariant = Impossible<(), CdrError>;
    type SerializeMap = Impossible<(), CdrError>;
    type SerializeStruct = &'a mut Cdr;
    type SerializeStructVariant = Impossible<(), CdrError>;

    numbers!(
        serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64,
        serialize_f32: f32, serialize_f64: f64
    );

    fn serialize_bool(self, truth: bool) -> Result<(), CdrError> {
        self.serialize_u8(truth.into())
    }

    fn serialize_char(self, _: char) -> Result<(), CdrError> {
        unknown("a character")
    }

    fn serialize_str(self, text: &str) -> Result<(), CdrError> {
        self.length(text.len() + 1)?;
        self.bytes.extend(text.bytes());
        self.bytes.push(0);
        Ok(())
    }

    fn serialize_bytes(self, bytes: &[u8]) -> Result<(), CdrError> {
        self.length(bytes.len())?;
        self.bytes.extend(bytes);
        Ok(())
    }

    fn serialize_none(self) -> Result<(), CdrError> {
        unknown("nothing")
    }

    fn serialize_some<T: Serialize + ?Sized>(self, _: &T) -> Result<(), CdrError> {
        unknown("something that may be missing")
    }

    fn serialize_unit(self) -> Result<(), CdrError> {
        unknown("nothing")
    }

    fn serialize_unit_struct(self, name: &'static str) -> Result<(), CdrError> {
        unknown(name)
    }

    fn serialize_unit_variant(self, name: &'static str, _: u32, _: &'static str) -> Result<(), CdrError> {
        unknown(name)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), CdrError> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<(), CdrError> {
        unknown(name)
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Self, CdrError> {
        match length {
            Some(length) => self.length(length)?,
            None => return unknown("a sequence of unknown length"),
        }
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeTupleVariant, CdrError> {
        unknown(name)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap, CdrError> {
        unknown("a map")
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeStructVariant, CdrError> {
        unknown(name)
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

impl SerializeSeq for &mut Cdr {
    type Ok = ();
    type Error = CdrError;

    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), CdrError> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), CdrError> {
        Ok(())
    }
}

impl SerializeTuple for &mut Cdr {
    type Ok = ();
    type Error = CdrError;

    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), CdrError> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), CdrError> {
        Ok(())
    }
}

impl SerializeTupleStruct for &mut Cdr {
    type Ok = ();
    type Error = CdrError;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), CdrError> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), CdrError> {
        Ok(())
    }
}

impl SerializeStruct for &mut Cdr {
    type Ok = ();
    type Error = CdrError;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, _: &'static str, value: &T) -> Result<(), CdrError> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), CdrError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::{DiagnosticStatus, Header, Level, Time};

    #[test]
    fn numbers_stand_at_multiples_of_their_size_and_strings_end_with_a_zero() {
        #[derive(serde::Serialize)]
        struct Example {
            byte: u8,
            number: f64,
            text: &'static str,
            flag: bool,
            list: Vec<u16>,
        }
        let example = Example {
            byte: 7,
            number: 1.0,
            text: "ab",
            flag: true,
            list: vec![1, 2],
        };
        let expected: Vec<u8> = [
            &[0, 1, 0, 0][..],
            &[7, 0, 0, 0, 0, 0, 0, 0],
            &1.0_f64.to_le_bytes(),
            &[3, 0, 0, 0, b'a', b'b', 0],
            &[1],
            &[2, 0, 0, 0, 1, 0, 2, 0],
        ]
        .concat();
        assert_eq!(to_cdr(&example), Ok(expected));
    }

    #[test]
    fn a_header_and_a_status_are_written_as_ros_writes_them() {
        let header = Header {
            stamp: Time::from_ns(1_000_000_002),
            frame_id: "a".to_owned(),
        };
        assert_eq!(
            to_cdr(&header).unwrap(),
            [0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, b'a', 0]
        );
        let status = DiagnosticStatus::new(String::new(), (Level::Error, ""), "", [("k", "v".to_owned())]);
        let body: Vec<u8> = [
            &[0, 1, 0, 0, 2, 0, 0, 0][..],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &[1, 0, 0, 0],
            &[2, 0, 0, 0, b'k', 0, 0, 0],
            &[2, 0, 0, 0, b'v', 0],
        ]
        .concat();
        assert_eq!(to_cdr(&status), Ok(body));
    }

    #[test]
    fn what_no_message_has_is_an_error() {
        assert!(to_cdr(&Some(1)).is_err());
        assert!(to_cdr(&'a').is_err());
    }
}
