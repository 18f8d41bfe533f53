//! The bits of a packed depth pixel (S17, S22, C10): one 32-bit word of geometry and one of colour.
//!
//! ```text
//! bit  31   30 ............. 20   19 ............................ 0      r g b a, one byte each
//!      0    splat index (11)      inverse depth over the range (20)
//! ```

/// One depth pixel at render time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PackedDepthPixel {
    /// Bits 0..20: inverse depth code; bits 20..31: splat index; bit 31: 0.
    pub geometry: u32,
    /// sRGB, straight alpha.
    pub color_srgb: [u8; 4],
}

const _: () = assert!(
    size_of::<PackedDepthPixel>() == 8,
    "four depth pixels to a 32-byte half cache line"
);

impl PackedDepthPixel {
    /// Returns the 20-bit inverse depth code.
    pub fn inverse_depth_code(self) -> u32 {
        self.geometry & INVERSE_DEPTH_CODE_MAX
    }

    /// Returns the 11-bit splat index.
    pub fn splat_index(self) -> u32 {
        self.geometry >> 20 & 0x7ff
    }
}

/// Largest inverse depth code: 20 bits.
pub const INVERSE_DEPTH_CODE_MAX: u32 = (1 << 20) - 1;

/// Layout of the 11-bit splat index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum SplatIndexLayout {
    /// Layout of the paper: 3 bits nx, 3 bits ny, 5 bits of depth, quantised exponentially (S20).
    Paper,
    /// All eleven bits for the normal; the depth is that of the inverse depth code (C10).
    Normal,
}
