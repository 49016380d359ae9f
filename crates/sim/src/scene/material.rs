//! Colours and solid textures.

use super::mesh::V3;

/// A solid pattern in texture coordinates (metres).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Pattern {
    Plain,
    /// Bands of `second` with a share `duty` of each period along `axis`.
    Stripes {
        axis: usize,
        period_m: f32,
        duty: f32,
        second: V3,
    },
    /// Two crossed sets of bands.
    Check {
        period_m: f32,
        second: V3,
    },
    /// Cloudy mixture with `second`, of the given grain.
    Mottle {
        grain_m: f32,
        second: V3,
    },
    /// Long streaks along the first axis, as of wood.
    Grain {
        grain_m: f32,
        second: V3,
    },
    /// Changes from the base colour to `second` between two heights of the third coordinate.
    Gradient {
        from_m: f32,
        to_m: f32,
        second: V3,
    },
}

/// How a surface answers to light. Colours are linear RGB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Material {
    pub(crate) colour: V3,
    pub(crate) pattern: Pattern,
    /// Strength of the highlight.
    pub(crate) shine: f32,
    /// How far light wraps round the edge, 0 for hard surfaces, 0.4 for skin.
    pub(crate) wrap: f32,
}

impl Material {
    pub(crate) fn matt(colour: V3) -> Self {
        Self { colour, pattern: Pattern::Plain, shine: 0.0, wrap: 0.1 }
    }

    pub(crate) fn skin(colour: V3) -> Self {
        Self { wrap: 0.3, shine: 0.05, ..Self::matt(colour) }
    }

    pub(crate) fn cloth(colour: V3, pattern: Pattern) -> Self {
        Self { pattern, wrap: 0.2, ..Self::matt(colour) }
    }

    pub(crate) fn metal(colour: V3) -> Self {
        Self { shine: 0.35, wrap: 0.0, ..Self::matt(colour) }
    }

    /// Colour at a texture coordinate.
    pub(crate) fn at(&self, tex: V3) -> V3 {
        match self.pattern {
            Pattern::Plain => self.colour,
            Pattern::Stripes { axis, period_m, duty, second } => {
                if (tex[axis] / period_m).rem_euclid(1.0) < duty {
                    second
                } else {
                    self.colour
                }
            }
            Pattern::Check { period_m, second } => {
                let on = |x: f32| u8::from((x / period_m).rem_euclid(1.0) < 0.4);
                let share = f32::from(on(tex.y) + on(tex.z) + on(tex.x).min(1)) / 3.0;
                self.colour.lerp(&second, share)
            }
            Pattern::Mottle { grain_m, second } => {
                let p = tex / grain_m;
                let share = 0.65 * lattice_noise(p) + 0.35 * lattice_noise(p * 2.7);
                self.colour.lerp(&second, share)
            }
            Pattern::Grain { grain_m, second } => {
                let p = tex / grain_m;
                let wave = lattice_noise(V3::new(p.x * 0.06, p.y, p.z));
                let fine = lattice_noise(V3::new(p.x * 0.15, p.y * 4.0, p.z * 4.0));
                self.colour.lerp(&second, 0.7 * wave + 0.3 * fine)
            }
            Pattern::Gradient { from_m, to_m, second } => {
                let share = ((tex.z - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
                self.colour.lerp(&second, share)
            }
        }
    }
}

fn lattice(x: i32, y: i32, z: i32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8DA6_B343)
        ^ (y as u32).wrapping_mul(0xD816_3841)
        ^ (z as u32).wrapping_mul(0xCB1A_B31F);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    ((h ^ (h >> 15)) >> 8) as f32 / 16_777_216.0
}

/// Trilinear noise in `[0, 1)` on the unit lattice.
pub(crate) fn lattice_noise(p: V3) -> f32 {
    let cell = p.map(f32::floor);
    let f = (p - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let (x, y, z) = (cell.x as i32, cell.y as i32, cell.z as i32);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |y: i32, z: i32| mix(lattice(x, y, z), lattice(x.wrapping_add(1), y, z), f.x);
    let layer = |z: i32| mix(row(y, z), row(y.wrapping_add(1), z), f.y);
    mix(layer(z), layer(z.wrapping_add(1)), f.z)
}

/// Linear RGB of an sRGB colour written as `0xRRGGBB`.
pub(crate) fn srgb(hex: u32) -> V3 {
    let channel = |shift: u32| linear(((hex >> shift) & 0xFF) as f32 / 255.0);
    V3::new(channel(16), channel(8), channel(0))
}

/// IEC 61966-2-1 decoding.
pub(crate) fn linear(s: f32) -> f32 {
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// IEC 61966-2-1 encoding.
fn encoded(l: f32) -> f32 {
    if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 }
}

/// Steps of the table from linear light to 8-bit sRGB; at 4096 the darkest steps are still below one code.
const ENCODE_STEPS: usize = 4096;

/// Linear light to 8-bit sRGB by table, with a soft shoulder above 0.8.
#[derive(Debug, Clone)]
pub(crate) struct Encoder {
    table: Vec<u8>,
}

impl Encoder {
    /// Largest light the table tells apart; brighter is white.
    const TOP: f32 = 2.0;

    pub(crate) fn new() -> Self {
        let table = (0..=ENCODE_STEPS)
            .map(|i| {
                let light = Self::TOP * i as f32 / ENCODE_STEPS as f32;
                let shown = if light < 0.8 { light } else { 0.8 + 0.2 * (1.0 - (-(light - 0.8) / 0.2).exp()) };
                (255.0 * encoded(shown) + 0.5) as u8
            })
            .collect();
        Self { table }
    }

    pub(crate) fn encode(&self, light: V3) -> [u8; 3] {
        let code = |l: f32| {
            let index = (l.clamp(0.0, Self::TOP) * (ENCODE_STEPS as f32 / Self::TOP)) as i32;
            self.table[(index as usize).min(ENCODE_STEPS)]
        };
        [code(light.x), code(light.y), code(light.z)]
    }
}
