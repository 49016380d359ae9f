//! Shadow maps: depth as the lamp sees it.

use super::look::Light;
use super::mesh::{Mesh, V3, unit};
use super::raster::{Buffer, Screen, View};

/// Depth margin, metres; below the texel size surfaces shade themselves, above 2 cm contact shadows detach.
const BIAS_M: f32 = 0.010;

/// Side of the blocks whose highest surface is kept, in texels.
const BLOCK: usize = 8;

/// A square parallel-light depth map about a centre.
#[derive(Debug, Clone)]
pub(crate) struct ShadowMap {
    right: V3,
    up: V3,
    towards: V3,
    centre: V3,
    texels_per_m: f32,
    buffer: Buffer,
    corners: Vec<Screen>,
    /// Highest surface of each block of texels and of the two texels beyond it.
    highest: Vec<f32>,
}

impl ShadowMap {
    pub(crate) fn new(light: &Light, centre: V3, half_m: f32, texels: usize) -> Self {
        let towards = unit(light.towards);
        let helper = if towards.z.abs() < 0.95 { V3::z() } else { V3::x() };
        let right = unit(helper.cross(&towards));
        Self {
            right,
            up: towards.cross(&right),
            towards,
            centre,
            texels_per_m: texels as f32 / (2.0 * half_m),
            buffer: Buffer::new(texels, texels),
            corners: Vec::new(),
            highest: vec![f32::NEG_INFINITY; (texels / BLOCK + 1) * (texels / BLOCK + 1)],
        }
    }

    pub(crate) fn draw(&mut self, mesh: &Mesh) {
        self.buffer.clear();
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        corners.extend(mesh.vertices.iter().map(|v| {
            let p = self.place(v.at);
            Screen { x: p.x, y: p.y, near: p.z }
        }));
        self.buffer.draw(&mesh.triangles, &corners, View::Light);
        self.corners = corners;
        self.summarise();
    }

    /// Finds the highest surface of every block, so that most lookups end at once.
    fn summarise(&mut self) {
        let side = self.buffer.width;
        let blocks = side / BLOCK + 1;
        self.highest.fill(f32::NEG_INFINITY);
        for (row, line) in self.buffer.near.chunks_exact(side).enumerate() {
            let above = row.saturating_sub(2) / BLOCK..=row / BLOCK;
            for (column, &near) in line.iter().enumerate() {
                if near > f32::NEG_INFINITY {
                    for y in above.clone() {
                        for x in column.saturating_sub(2) / BLOCK..=column / BLOCK {
                            let slot = &mut self.highest[y * blocks + x];
                            *slot = slot.max(near);
                        }
                    }
                }
            }
        }
    }

    /// Map coordinates of a point: texel column and row, and height along the light (metres).
    pub(crate) fn place(&self, at: V3) -> V3 {
        let d = at - self.centre;
        let middle = self.buffer.width as f32 * 0.5;
        V3::new(
            d.dot(&self.right) * self.texels_per_m + middle,
            d.dot(&self.up) * self.texels_per_m + middle,
            d.dot(&self.towards),
        )
    }

    /// Share of the lamp seen from map coordinates `p`, filtered over 3 x 3 texels.
    pub(crate) fn lit(&self, p: V3) -> f32 {
        let (width, height) = (self.buffer.width, self.buffer.height);
        let (x, y) = (p.x - 0.5, p.y - 0.5);
        if !(x >= 0.0 && y >= 0.0 && x < width as f32 - 3.0 && y < height as f32 - 3.0) {
            return 1.0;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let limit = p.z + BIAS_M;
        if self.highest[row / BLOCK * (width / BLOCK + 1) + column / BLOCK] <= limit {
            return 1.0;
        }
        let mut sum = 0.0;
        for (k, wy) in [(0, 1.0 - fy), (1, 1.0), (2, fy)] {
            let start = (row + k) * width + column;
            let line = &self.buffer.near[start..start + 3];
            let blocked = |near: f32, w: f32| if near > limit { 0.0 } else { w };
            sum += wy * (blocked(line[0], 1.0 - fx) + blocked(line[1], 1.0) + blocked(line[2], fx));
        }
        sum * 0.25
    }
}

/// Share of soft light that reaches a point with this normal past spheres: the product of `1 - r^2 cos / d^2`.
pub(crate) fn openness(at: V3, normal: V3, blockers: &[(V3, f32)]) -> f32 {
    let mut open = 1.0;
    for &(centre, radius) in blockers {
        let v = centre - at;
        let facing = v.dot(&normal);
        if facing > 0.0 {
            let d2 = v.norm_squared().max(radius * radius);
            let share = radius * radius * facing / (d2 * d2.sqrt());
            open *= 1.0 - 0.85 * share.min(1.0);
        }
    }
    open
}
