//! Colours, clothes, furniture and light of a picture.

use super::material::{Material, Pattern, srgb};
use super::mesh::V3;

/// Slots of the material table.
pub(crate) mod slot {
    pub(crate) const SKIN: u8 = 0;
    pub(crate) const SHIRT: u8 = 1;
    pub(crate) const TROUSERS: u8 = 2;
    pub(crate) const HAIR: u8 = 3;
    pub(crate) const EYE_WHITE: u8 = 4;
    pub(crate) const IRIS: u8 = 5;
    pub(crate) const LIPS: u8 = 6;
    pub(crate) const SHOE: u8 = 7;
    pub(crate) const FABRIC: u8 = 8;
    pub(crate) const FABRIC_BACK: u8 = 9;
    pub(crate) const NAIL: u8 = 10;
    pub(crate) const BENCH: u8 = 11;
    pub(crate) const BENCH_EDGE: u8 = 12;
    pub(crate) const MACHINE: u8 = 13;
    pub(crate) const METAL: u8 = 14;
    pub(crate) const WALL: u8 = 15;
    pub(crate) const FLOOR: u8 = 16;
    pub(crate) const CHAIR: u8 = 17;
    pub(crate) const ACCENT: u8 = 18;
    pub(crate) const PANE: u8 = 19;
    /// First of the colours used for spools and other small things.
    pub(crate) const SMALL: u8 = 20;
    /// Number of such colours.
    pub(crate) const SMALLS: u8 = 8;
}

/// Cut of the hair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HairCut {
    Bald,
    Short,
    Long,
    Bun,
    Cap,
}

/// A box, cylinder or picture placed among the furniture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clutter {
    pub(crate) centre: V3,
    pub(crate) half: V3,
    pub(crate) material: u8,
    pub(crate) round: bool,
}

/// The light of the room.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Light {
    /// Towards the lamp.
    pub(crate) towards: V3,
    pub(crate) key: V3,
    /// Light from above and from below.
    pub(crate) sky: V3,
    pub(crate) ground: V3,
}

/// Everything about a picture that is neither pose nor camera.
#[derive(Debug, Clone)]
pub(crate) struct Look {
    pub(crate) materials: Vec<Material>,
    pub(crate) hair: HairCut,
    /// Share of the arm covered by the sleeve.
    pub(crate) sleeve: f32,
    /// Looseness of the clothes, metres.
    pub(crate) loose_m: f32,
    /// Size of the fabric, metres.
    pub(crate) fabric_m: [f32; 2],
    /// A second cloth over wrist and forearm, as half sizes in metres; none in the default look.
    pub(crate) cover_m: Option<[f32; 2]>,
    /// Where along the right forearm (0 elbow, 1 wrist, 1.5 hand) the cover lies.
    pub(crate) cover_at: f32,
    pub(crate) machine: bool,
    pub(crate) machine_at: [f32; 2],
    pub(crate) shelf: bool,
    /// Distance from the origin to the wall behind the worker, metres.
    pub(crate) wall_m: f32,
    pub(crate) clutter: Vec<Clutter>,
    pub(crate) light: Light,
}

impl Default for Look {
    fn default() -> Self {
        let mut materials = vec![Material::matt(srgb(0x0080_8080)); usize::from(slot::SMALL + slot::SMALLS)];
        let mut put = |index: u8, material: Material| materials[usize::from(index)] = material;
        put(slot::SKIN, Material::skin(srgb(0x00D9_A17E)));
        put(slot::SHIRT, Material::cloth(srgb(0x002F_6FA8), Pattern::Plain));
        put(slot::TROUSERS, Material::cloth(srgb(0x0033_3A48), Pattern::Plain));
        put(slot::HAIR, Material { shine: 0.12, ..Material::matt(srgb(0x0033_2620)) });
        put(slot::EYE_WHITE, Material::matt(srgb(0x00F2_EFEA)));
        put(slot::IRIS, Material::matt(srgb(0x0024_1A14)));
        put(slot::LIPS, Material::skin(srgb(0x00A8_564E)));
        put(slot::SHOE, Material::matt(srgb(0x0020_2020)));
        let weave = |a: u32, b: u32| {
            Material::cloth(srgb(a), Pattern::Stripes { axis: 1, period_m: 0.04, duty: 0.22, second: srgb(b) })
        };
        put(slot::FABRIC, weave(0x00E3_B23C, 0x00F4_E2B0));
        put(slot::FABRIC_BACK, Material::cloth(srgb(0x00F0_DCA8), Pattern::Plain));
        put(slot::NAIL, Material::skin(srgb(0x00E7_BFA6)));
        let wood = Pattern::Grain { grain_m: 0.035, second: srgb(0x00B9_9468) };
        put(slot::BENCH, Material { pattern: wood, ..Material::matt(srgb(0x00CF_AE84)) });
        put(slot::BENCH_EDGE, Material::matt(srgb(0x0070_5238)));
        put(slot::MACHINE, Material { shine: 0.25, ..Material::matt(srgb(0x00EC_EBE4)) });
        put(slot::METAL, Material::metal(srgb(0x0090_969C)));
        let shade = Pattern::Gradient { from_m: 1.9, to_m: -0.6, second: srgb(0x00A3_ACB0) };
        put(slot::WALL, Material { pattern: shade, ..Material::matt(srgb(0x00D3_D8D8)) });
        put(slot::FLOOR, Material::matt(srgb(0x0077_7A7C)));
        put(slot::CHAIR, Material::matt(srgb(0x002B_2E33)));
        put(slot::ACCENT, Material::matt(srgb(0x003C_6E71)));
        put(slot::PANE, Material::matt(srgb(0x00E8_F1F8)));
        let spools =
            [0x00C8_3E4D, 0x00F2_A541, 0x004A_8F5C, 0x0036_6FA0, 0x0076_4F8E, 0x00E8_E4DA, 0x002C_2C34, 0x00D9_7B93];
        for (k, hex) in spools.into_iter().enumerate() {
            put(slot::SMALL + k as u8, Material::matt(srgb(hex)));
        }
        Self {
            materials,
            hair: HairCut::Short,
            sleeve: 0.3,
            loose_m: 0.010,
            fabric_m: [0.26, 0.16],
            cover_m: None,
            cover_at: 0.9,
            machine: true,
            machine_at: [0.30, 0.42],
            shelf: true,
            wall_m: 1.3,
            clutter: Vec::new(),
            light: Light {
                towards: super::mesh::unit(V3::new(0.55, -0.45, 1.0)),
                key: V3::new(0.78, 0.74, 0.66),
                sky: V3::new(0.40, 0.43, 0.47),
                ground: V3::new(0.20, 0.18, 0.16),
            },
        }
    }
}
