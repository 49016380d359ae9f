//! Bench, sewing machine, chair, walls: everything that stands still.

use super::look::{Look, slot};
use super::mesh::{Mesh, Part, Ring, V3};

/// Half size of the bench top and its middle, metres.
const BENCH_HALF_M: [f32; 2] = [0.42, 0.72];
const BENCH_MIDDLE_M: [f32; 2] = [0.30, 0.04];
const BENCH_THICK_M: f32 = 0.03;
const FLOOR_M: f32 = -0.75;

fn axes(x: f32, y: f32, z: f32) -> [V3; 3] {
    [V3::new(x, 0.0, 0.0), V3::new(0.0, y, 0.0), V3::new(0.0, 0.0, z)]
}

fn block(mesh: &mut Mesh, material: u8, centre: [f32; 3], half: [f32; 3]) {
    mesh.cuboid(Part::Background, material, V3::from(centre), axes(half[0], half[1], half[2]), 1);
}

/// A cylinder or cone between two points with radii at both ends.
fn rod(mesh: &mut Mesh, material: u8, (from, r0): (V3, f32), (to, r1): (V3, f32), sides: u32) {
    let axis = super::mesh::unit(to - from);
    let helper = if axis.z.abs() < 0.9 { V3::z() } else { V3::x() };
    let a = super::mesh::unit(helper.cross(&axis));
    let b = axis.cross(&a);
    // Doubled end rings keep the rims sharp.
    let rings = [(from, r0 * 0.96), (from, r0), (to, r1), (to, r1 * 0.96)].map(|(centre, r)| Ring {
        centre,
        a: a * r,
        b: b * r,
        along: (centre - from).norm(),
        material,
        part: Part::Background,
    });
    mesh.tube(&rings, sides);
}

fn machine(mesh: &mut Mesh, [x, y]: [f32; 2]) {
    let body = slot::MACHINE;
    // Bed with needle plate, column on the left of the worker, arm reaching to the right, head with needle.
    block(mesh, body, [x, y, 0.018], [0.085, 0.21, 0.018]);
    block(mesh, slot::METAL, [x - 0.01, y - 0.15, 0.037], [0.035, 0.045, 0.0015]);
    let round = |mesh: &mut Mesh, path: &[([f32; 3], f32, f32)]| {
        let rings: Vec<Ring> = path
            .iter()
            .map(|&(c, a, b)| Ring {
                centre: V3::new(x + c[0], y + c[1], c[2]),
                a: V3::new(a, 0.0, 0.0),
                b: V3::new(0.0, c[1] * 0.0, b),
                along: c[1],
                material: body,
                part: Part::Background,
            })
            .collect();
        mesh.tube(&rings, 16);
    };
    block(mesh, body, [x, y + 0.155, 0.13], [0.058, 0.052, 0.10]);
    round(
        mesh,
        &[
            ([0.0, 0.215, 0.245], 0.030, 0.032),
            ([0.0, 0.205, 0.245], 0.058, 0.056),
            ([0.0, 0.10, 0.245], 0.058, 0.056),
            ([0.0, 0.02, 0.250], 0.046, 0.042),
            ([0.0, -0.10, 0.250], 0.046, 0.042),
            ([0.0, -0.185, 0.245], 0.050, 0.050),
            ([0.0, -0.195, 0.245], 0.036, 0.038),
        ],
    );
    block(mesh, body, [x, y - 0.15, 0.185], [0.042, 0.040, 0.065]);
    rod(mesh, slot::METAL, (V3::new(x, y - 0.15, 0.12), 0.009), (V3::new(x, y - 0.15, 0.07), 0.009), 8);
    rod(mesh, slot::METAL, (V3::new(x, y - 0.15, 0.07), 0.003), (V3::new(x, y - 0.15, 0.035), 0.002), 6);
    block(mesh, slot::METAL, [x - 0.015, y - 0.15, 0.043], [0.020, 0.012, 0.003]);
    rod(mesh, slot::METAL, (V3::new(x, y + 0.215, 0.245), 0.05), (V3::new(x, y + 0.245, 0.245), 0.05), 18);
    block(mesh, slot::ACCENT, [x - 0.059, y + 0.15, 0.15], [0.002, 0.03, 0.05]);
    rod(mesh, slot::METAL, (V3::new(x + 0.01, y + 0.12, 0.30), 0.004), (V3::new(x + 0.01, y + 0.12, 0.40), 0.004), 6);
    rod(
        mesh,
        slot::SMALL,
        (V3::new(x + 0.01, y + 0.12, 0.305), 0.026),
        (V3::new(x + 0.01, y + 0.12, 0.375), 0.015),
        12,
    );
}

fn shelf(mesh: &mut Mesh, wall: f32) {
    for (row, z) in [0.62_f32, 0.98].into_iter().enumerate() {
        block(mesh, slot::BENCH_EDGE, [-wall + 0.09, -0.15, z], [0.09, 0.75, 0.012]);
        for k in 0..11_u8 {
            let y = -0.80 + 0.13 * f32::from(k) + 0.02 * row as f32;
            let colour = slot::SMALL + (k * 3 + 5 * row as u8) % slot::SMALLS;
            let at = V3::new(-wall + 0.09, y, z + 0.012);
            rod(mesh, colour, (at, 0.045), (at + V3::new(0.0, 0.0, 0.15), 0.022), 10);
        }
    }
}

/// Adds the room as `look` describes it; the chair stands under `seat` (the middle of the hips).
pub(crate) fn add(mesh: &mut Mesh, look: &Look, seat: V3) {
    let wall = look.wall_m;
    let background = Part::Background;
    mesh.sheet(
        background,
        slot::WALL,
        V3::new(-wall, 0.0, 1.0),
        V3::new(0.0, 4.0, 0.0),
        V3::new(0.0, 0.0, 1.76),
        (32, 14),
        false,
    );
    for side in [-1.0, 1.0] {
        mesh.sheet(
            background,
            slot::WALL,
            V3::new(1.0, side * 3.2, 1.0),
            V3::new(side * 3.0, 0.0, 0.0),
            V3::new(0.0, 0.0, 1.76),
            (24, 14),
            false,
        );
    }
    mesh.sheet(
        background,
        slot::FLOOR,
        V3::new(0.5, 0.0, FLOOR_M),
        V3::new(3.2, 0.0, 0.0),
        V3::new(0.0, 4.0, 0.0),
        (32, 32),
        false,
    );
    let [mx, my] = BENCH_MIDDLE_M;
    let [hx, hy] = BENCH_HALF_M;
    mesh.sheet(
        background,
        slot::BENCH,
        V3::new(mx, my, 0.0),
        V3::new(hx, 0.0, 0.0),
        V3::new(0.0, hy, 0.0),
        (21, 36),
        false,
    );
    mesh.cuboid(
        background,
        slot::BENCH_EDGE,
        V3::new(mx, my, -BENCH_THICK_M * 0.5 - 0.0005),
        axes(hx, hy, BENCH_THICK_M * 0.5),
        6,
    );
    for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let foot = V3::new(mx + sx * (hx - 0.05), my + sy * (hy - 0.06), FLOOR_M);
        rod(mesh, slot::CHAIR, (foot, 0.02), (foot + V3::new(0.0, 0.0, -FLOOR_M - 0.03), 0.02), 8);
    }
    let under = V3::new(seat.x - 0.02, seat.y, seat.z - 0.13);
    rod(mesh, slot::CHAIR, (under, 0.19), (under + V3::new(0.0, 0.0, 0.05), 0.185), 20);
    rod(mesh, slot::METAL, (V3::new(under.x, under.y, FLOOR_M), 0.025), (under, 0.025), 8);
    if look.machine {
        machine(mesh, look.machine_at);
    }
    if look.shelf {
        shelf(mesh, wall);
    }
    for c in &look.clutter {
        if c.round {
            let down = V3::new(0.0, 0.0, c.half.z);
            rod(mesh, c.material, (c.centre - down, c.half.x), (c.centre + down, c.half.y), 12);
        } else {
            mesh.cuboid(background, c.material, c.centre, axes(c.half.x, c.half.y, c.half.z), 2);
        }
    }
}
