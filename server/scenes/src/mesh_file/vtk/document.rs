//! The XML of a file: its pieces with their arrays, which are not unpacked yet.

use std::borrow::Cow;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::super::text;
use crate::kind::Kind;

/// What stands before the data that are kept behind the XML.
const APPENDED: &[u8] = b"<AppendedData";
const END_OF_APPENDED: &[u8] = b"</AppendedData";

/// A file.
#[derive(Default)]
pub(super) struct Document<'a> {
    pub packing: Packing,
    pub pieces: Vec<Piece<'a>>,
    /// What arrays that are `appended` point into, behind its underscore.
    pub appended: Option<Appended<'a>>,
}

/// How binary arrays stand in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Packing {
    pub is_big: bool,
    /// Lengths have 64 bits, not 32.
    pub has_long_header: bool,
    /// Blocks are packed by zlib.
    pub is_compressed: bool,
}

/// Data behind the XML.
#[derive(Clone, Copy)]
pub(super) struct Appended<'a> {
    pub is_base64: bool,
    pub bytes: &'a [u8],
}

/// A part of a grid, with vertices of its own.
#[derive(Default)]
pub(super) struct Piece<'a> {
    pub points: u64,
    pub cells: u64,
    arrays: Vec<(Section, Array<'a>)>,
}

impl<'a> Piece<'a> {
    /// The array of this name, or any where `name` is `None`.
    pub fn array(&self, section: Section, name: Option<&str>) -> Option<&Array<'a>> {
        let is_it = |(of, array): &&(Section, Array<'a>)| *of == section && name.is_none_or(|name| array.name == name);
        self.arrays.iter().find(is_it).map(|(_, array)| array)
    }
}

/// What arrays that are read belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Section {
    Points,
    Cells,
    Strips,
    Polygons,
}

impl Section {
    fn of(element: &str) -> Option<Self> {
        Some(match element {
            "Points" => Self::Points,
            "Cells" => Self::Cells,
            "Strips" => Self::Strips,
            "Polys" => Self::Polygons,
            _ => return None,
        })
    }
}

/// Numbers, as they stand in the file.
pub(super) struct Array<'a> {
    pub name: String,
    pub kind: Kind,
    pub place: Place<'a>,
}

/// Where an array's numbers are.
pub(super) enum Place<'a> {
    /// Here, as words.
    Text(Cow<'a, str>),
    /// Here, as base64.
    Base64(Cow<'a, str>),
    /// So far behind the underscore of the data behind the XML.
    Appended(u64),
}

impl<'a> Document<'a> {
    pub fn read(bytes: &'a [u8]) -> Result<Self, String> {
        if !bytes.trim_ascii_end().ends_with(b"</VTKFile>") {
            return Err("the file is cut off: it does not end with `</VTKFile>`; export it again".into());
        }
        let mut document = Self::default();
        let xml = match find(bytes, APPENDED) {
            None => bytes,
            Some(begin) => {
                let end = bytes[begin..].iter().position(|byte| *byte == b'>').ok_or("`<AppendedData` has no end")?;
                &bytes[..=begin + end]
            }
        };
        let xml_text = text(xml)?;
        let mut parser = Parser { reader: Reader::from_str(xml_text), section: None, array: None };
        document.read_xml(&mut parser).map_err(|message| {
            let read = parser.reader.buffer_position().min(xml.len() as u64) as usize;
            format!("line {}: {message}", xml[..read].iter().filter(|byte| **byte == b'\n').count() + 1)
        })?;
        if let Some(appended) = &mut document.appended {
            let behind = bytes[xml.len()..].trim_ascii_start();
            let data =
                behind.strip_prefix(b"_").ok_or("the data of `<AppendedData>` begin with `_`, which is not there")?;
            let end = find_last(data, END_OF_APPENDED);
            appended.bytes =
                &data[..end.ok_or("the file is cut off: `</AppendedData>` is missing; export it again")?];
        }
        Ok(document)
    }

    fn read_xml(&mut self, parser: &mut Parser<'a>) -> Result<(), String> {
        let mut has_begun = false;
        loop {
            match parser.reader.read_event().map_err(|error| error.to_string())? {
                Event::Start(element) if parser.array.is_some() => {
                    // Remarks about the array, as its range.
                    parser.reader.read_to_end(element.name()).map_err(|error| error.to_string())?;
                }
                Event::Empty(_) if parser.array.is_some() => {}
                Event::Start(element) => {
                    let name = element.name();
                    match name.as_ref() {
                        "VTKFile" => {
                            self.packing = packing(&element)?;
                            has_begun = true;
                        }
                        "DataArray" => parser.array = parser.section.is_some().then(|| array(&element)).transpose()?,
                        other => self.begin(other, &element, parser)?,
                    }
                }
                Event::Empty(element) => match element.name().as_ref() {
                    "DataArray" => {
                        if let Some(section) = parser.section {
                            self.push(section, array(&element)?)?;
                        }
                    }
                    // Its section is over as soon as it has begun.
                    "Piece" => self.begin("Piece", &element, parser)?,
                    _ => {}
                },
                Event::Text(words) => {
                    let place = parser.array.as_mut().map(|array| &mut array.place);
                    if let Some(Place::Text(text) | Place::Base64(text)) = place {
                        join(text, words.into_inner());
                    }
                }
                Event::End(element) => match element.name().as_ref() {
                    "DataArray" => {
                        if let (Some(section), Some(array)) = (parser.section, parser.array.take()) {
                            self.push(section, array)?;
                        }
                    }
                    other if Section::of(other).is_some() => parser.section = None,
                    _ => {}
                },
                Event::Eof if has_begun => return Ok(()),
                Event::Eof => return Err("a file of VTK has an element VTKFile".into()),
                _ => {}
            }
        }
    }

    fn begin(&mut self, name: &str, element: &BytesStart<'_>, parser: &mut Parser<'_>) -> Result<(), String> {
        match name {
            "Piece" => {
                let (points, cells) = (count(element, "NumberOfPoints")?, count(element, "NumberOfCells")?);
                self.pieces.push(Piece { points, cells, arrays: Vec::new() });
            }
            "AppendedData" => {
                let encoding = attribute(element, "encoding")?;
                let is_base64 = match encoding.as_deref() {
                    Some("base64") => true,
                    Some("raw") => false,
                    other => {
                        return Err(format!("encoding is `{}`; raw and base64 are read", other.unwrap_or_default()));
                    }
                };
                self.appended = Some(Appended { is_base64, bytes: &[] });
            }
            _ => {}
        }
        parser.section = Section::of(name);
        Ok(())
    }

    fn push(&mut self, section: Section, array: Array<'a>) -> Result<(), String> {
        let piece = self.pieces.last_mut().ok_or("an array stands outside of a piece")?;
        piece.arrays.push((section, array));
        Ok(())
    }
}

/// How far the XML is read.
struct Parser<'a> {
    reader: Reader<&'a [u8]>,
    section: Option<Section>,
    array: Option<Array<'a>>,
}

fn join<'a>(text: &mut Cow<'a, str>, more: Cow<'a, str>) {
    if text.is_empty() {
        *text = more;
    } else {
        text.to_mut().push_str(&more);
    }
}

fn attribute(element: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    let found = element.try_get_attribute(name).map_err(|error| error.to_string())?;
    Ok(found.map(|attribute| attribute.value.into_owned()))
}

/// How many things a piece says to have; none where it does not say.
fn count(element: &BytesStart<'_>, name: &str) -> Result<u64, String> {
    let word = attribute(element, name)?.unwrap_or_else(|| "0".into());
    word.trim().parse().map_err(|_| format!("{name} is `{word}`, which is not a number of things"))
}

fn packing(element: &BytesStart<'_>) -> Result<Packing, String> {
    match attribute(element, "type")?.unwrap_or_default().as_str() {
        "UnstructuredGrid" | "PolyData" => {}
        other => return Err(format!("the file is of type `{other}`; UnstructuredGrid and PolyData are read")),
    }
    let is_big = match attribute(element, "byte_order")?.as_deref() {
        None | Some("LittleEndian") => false,
        Some("BigEndian") => true,
        Some(other) => return Err(format!("byte_order is `{other}`; LittleEndian and BigEndian are read")),
    };
    let has_long_header = match attribute(element, "header_type")?.as_deref() {
        None | Some("UInt32") => false,
        Some("UInt64") => true,
        Some(other) => return Err(format!("header_type is `{other}`; UInt32 and UInt64 are read")),
    };
    let is_compressed = match attribute(element, "compressor")?.as_deref() {
        None | Some("") => false,
        Some("vtkZLibDataCompressor") => true,
        Some(other) => {
            return Err(format!("compressor is `{other}`; vtkZLibDataCompressor is read: export it so, or not packed"));
        }
    };
    Ok(Packing { is_big, has_long_header, is_compressed })
}

fn array<'a>(element: &BytesStart<'_>) -> Result<Array<'a>, String> {
    let name = attribute(element, "Name")?.unwrap_or_default();
    let word = attribute(element, "type")?.unwrap_or_default();
    let kind = match word.as_str() {
        "Int8" => Kind::I8,
        "UInt8" => Kind::U8,
        "Int16" => Kind::I16,
        "UInt16" => Kind::U16,
        "Int32" => Kind::I32,
        "UInt32" => Kind::U32,
        "Int64" => Kind::I64,
        "UInt64" => Kind::U64,
        "Float32" => Kind::F32,
        "Float64" => Kind::F64,
        other => return Err(format!("array {name}: `{other}` is not a type of numbers, as Float32 or Int64 are")),
    };
    let place = match attribute(element, "format")?.as_deref() {
        None | Some("ascii") => Place::Text(Cow::default()),
        Some("binary") => Place::Base64(Cow::default()),
        Some("appended") => {
            let word = attribute(element, "offset")?.unwrap_or_default();
            Place::Appended(
                word.trim().parse().map_err(|_| format!("array {name}: offset is `{word}`, not a number of bytes"))?,
            )
        }
        Some(other) => return Err(format!("array {name}: format is `{other}`; ascii, binary and appended are read")),
    };
    Ok(Array { name, kind, place })
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    bytes.windows(wanted.len()).position(|window| window == wanted)
}

fn find_last(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    bytes.windows(wanted.len()).rposition(|window| window == wanted)
}
