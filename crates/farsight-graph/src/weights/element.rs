//! Number formats that a file may hold, all read to `f32`.

use half::{bf16, f16};
use safetensors::Dtype;

/// How one number of a weight file is written; always little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// Half precision.
    F16,
    /// bfloat16.
    Bf16,
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Counters, `num_batches_tracked` for instance.
    I64,
}

impl Element {
    /// The format of this safetensors type, if networks use it.
    pub fn from_dtype(dtype: Dtype) -> Option<Self> {
        match dtype {
            Dtype::F16 => Some(Self::F16),
            Dtype::BF16 => Some(Self::Bf16),
            Dtype::F32 => Some(Self::F32),
            Dtype::F64 => Some(Self::F64),
            Dtype::I64 => Some(Self::I64),
            _ => None,
        }
    }

    /// Its safetensors type.
    pub const fn dtype(self) -> Dtype {
        match self {
            Self::F16 => Dtype::F16,
            Self::Bf16 => Dtype::BF16,
            Self::F32 => Dtype::F32,
            Self::F64 => Dtype::F64,
            Self::I64 => Dtype::I64,
        }
    }

    /// Bytes of one number.
    pub const fn size(self) -> usize {
        match self {
            Self::F16 | Self::Bf16 => 2,
            Self::F32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }

    /// All numbers in `bytes`; what is left over behind the last whole number is not read.
    pub fn decode(self, bytes: &[u8]) -> Vec<f32> {
        match self {
            Self::F16 => decode(bytes, |b| f16::from_le_bytes(b).to_f32()),
            Self::Bf16 => decode(bytes, |b| bf16::from_le_bytes(b).to_f32()),
            Self::F32 => decode(bytes, f32::from_le_bytes),
            Self::F64 => decode(bytes, |b| f64::from_le_bytes(b) as f32),
            Self::I64 => decode(bytes, |b| i64::from_le_bytes(b) as f32),
        }
    }

    /// Appends `values` to `bytes` in this format, rounded to the nearest.
    pub fn encode(self, values: &[f32], bytes: &mut Vec<u8>) {
        match self {
            Self::F16 => bytes.extend(values.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes())),
            Self::Bf16 => bytes.extend(values.iter().flat_map(|v| bf16::from_f32(*v).to_le_bytes())),
            Self::F32 => bytes.extend(values.iter().flat_map(|v| v.to_le_bytes())),
            Self::F64 => bytes.extend(values.iter().flat_map(|v| f64::from(*v).to_le_bytes())),
            Self::I64 => bytes.extend(values.iter().flat_map(|v| (*v as i64).to_le_bytes())),
        }
    }
}

fn decode<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|chunk| number(*chunk)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_reads_minus_one_and_a_half() {
        let rows: [(Element, &[u8]); 4] = [
            (Element::F16, &f16::from_f32(-1.5).to_le_bytes()),
            (Element::Bf16, &bf16::from_f32(-1.5).to_le_bytes()),
            (Element::F32, &(-1.5_f32).to_le_bytes()),
            (Element::F64, &(-1.5_f64).to_le_bytes()),
        ];
        for (element, bytes) in rows {
            assert_eq!(bytes.len(), element.size(), "{element:?}");
            assert_eq!(element.decode(bytes), [-1.5], "{element:?}");
            let mut written = Vec::new();
            element.encode(&[-1.5], &mut written);
            assert_eq!(written, bytes, "{element:?}");
        }
        assert_eq!(Element::I64.decode(&(-3_i64).to_le_bytes()), [-3.0]);
    }
}
