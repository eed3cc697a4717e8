//! A position in the bytes of a file, which advances by words, lines or bytes.

use super::Fault;

pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u32,
}

/// A type of binary numbers: its class and its size in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind(Class, usize);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Class {
    Signed,
    Unsigned,
    Float,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Little,
    Big,
}

impl Kind {
    pub const I32: Self = Self(Class::Signed, 4);
    pub const U32: Self = Self(Class::Unsigned, 4);
    pub const U64: Self = Self(Class::Unsigned, 8);
    pub const F32: Self = Self(Class::Float, 4);
    pub const F64: Self = Self(Class::Float, 8);

    /// The type of a name in VTK or PLY.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "char" | "int8" | "signed_char" => Self(Class::Signed, 1),
            "uchar" | "uint8" | "unsigned_char" => Self(Class::Unsigned, 1),
            "short" | "int16" => Self(Class::Signed, 2),
            "ushort" | "uint16" | "unsigned_short" => Self(Class::Unsigned, 2),
            "int" | "int32" => Self::I32,
            "uint" | "uint32" | "unsigned_int" => Self::U32,
            "long" | "int64" | "vtktypeint64" | "vtkidtype" => Self(Class::Signed, 8),
            "unsigned_long" | "uint64" => Self::U64,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub fn size(self) -> usize {
        self.1
    }

    /// The number in some bytes; NaN where there are too few. Whole numbers are exact up to 2⁵³.
    pub fn number(self, bytes: &[u8], order: Order) -> f64 {
        let Self(class, size) = self;
        let mut eight = [0; 8];
        let (Some(bytes), Some(low)) = (bytes.get(..size), eight.get_mut(..size)) else { return f64::NAN };
        low.copy_from_slice(bytes);
        if order == Order::Big {
            low.reverse();
        }
        let bits = u64::from_le_bytes(eight);
        // The bits above those of the number, which its sign fills.
        let above = 64 - 8 * size;
        match class {
            Class::Signed => ((bits << above) as i64 >> above) as f64,
            Class::Unsigned => bits as f64,
            Class::Float if size == 4 => f64::from(f32::from_bits(bits as u32)),
            Class::Float => f64::from_bits(bits),
        }
    }
}

/// A number as a count or index, if it is one.
pub fn whole(number: f64) -> Option<u32> {
    (number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&number)).then_some(number as u32)
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, line: 1 }
    }

    /// The line that the cursor is in, from 1.
    pub fn line(&self) -> u32 {
        self.line
    }

    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    pub fn fault(&self, message: impl std::fmt::Display) -> Fault {
        Fault(format!("line {}: {message}", self.line))
    }

    /// The next word, behind any white space.
    pub fn word(&mut self) -> Option<&'a str> {
        let blank = self.rest().iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        self.skip(blank);
        let rest = self.rest();
        let length = rest.iter().take_while(|byte| !byte.is_ascii_whitespace()).count();
        self.at += length;
        (length > 0).then(|| text(&rest[..length]))
    }

    /// The rest of the line, which ends in \n, \r\n or \r; the cursor moves to the next one.
    pub fn rest_of_line(&mut self) -> &'a str {
        let rest = self.rest();
        let length = rest.iter().take_while(|byte| !matches!(byte, b'\n' | b'\r')).count();
        let end = if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
        self.skip((length + end).min(rest.len()));
        text(&rest[..length])
    }

    pub fn number(&mut self) -> Result<f64, Fault> {
        let word = self.word().ok_or_else(|| self.fault("ends where a number is missing"))?;
        word.parse().map_err(|_| self.fault(format_args!("{word:?} is no number")))
    }

    pub fn whole(&mut self) -> Result<u32, Fault> {
        let number = self.number()?;
        self.as_whole(number)
    }

    /// A number that was just read, as a count or index.
    pub fn as_whole(&self, number: f64) -> Result<u32, Fault> {
        let rule = format_args!("a whole number from 0 to {} is wanted", u32::MAX - 1);
        whole(number).ok_or_else(|| self.fault(format_args!("{number} is no count or index: {rule}")))
    }

    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let bytes = self.rest().get(..count).ok_or_else(|| self.fault("binary data end too early"))?;
        self.at += count;
        Ok(bytes)
    }

    /// The next number, binary where there is a byte order, else a word.
    pub fn next(&mut self, kind: Kind, order: Option<Order>) -> Result<f64, Fault> {
        match order {
            Some(order) => Ok(kind.number(self.take(kind.size())?, order)),
            None => self.number(),
        }
    }

    fn skip(&mut self, count: usize) {
        let rest = self.rest();
        let ends = |&at: &usize| match rest.get(at) {
            Some(b'\n') => true,
            Some(b'\r') => rest.get(at + 1) != Some(&b'\n'),
            _ => false,
        };
        self.line += (0..count).filter(ends).count() as u32;
        self.at += count;
    }
}

/// Bytes as text; other bytes have no meaning in any format.
fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap_or("\u{fffd}")
}
