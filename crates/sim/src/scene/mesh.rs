//! Triangle meshes and the shapes they are built from.

use std::f32::consts::TAU;

use nalgebra::Vector3;

pub(crate) type V3 = Vector3<f32>;

/// Unit vector along `v`, or zero for a vector without length.
pub(crate) fn unit(v: V3) -> V3 {
    let n = v.norm();
    if n > 1e-12 { v / n } else { V3::zeros() }
}

/// What a triangle belongs to; decides which keypoints it may hide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(crate) enum Part {
    Background,
    Torso,
    Head,
    Hair,
    RightUpperArm,
    RightForearm,
    RightHand,
    LeftUpperArm,
    LeftForearm,
    LeftHand,
    RightThigh,
    LeftThigh,
    RightShin,
    LeftShin,
    Fabric,
}

impl Part {
    /// Whether the part is of the worker's body (hair and clothes included).
    pub(crate) fn is_body(self) -> bool {
        !matches!(self, Self::Background | Self::Fabric)
    }
}

/// A corner of a mesh.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Vertex {
    /// Position in `world`, metres.
    pub(crate) at: V3,
    pub(crate) normal: V3,
    /// Coordinates of the solid texture, metres in the part's own frame.
    pub(crate) tex: V3,
    /// Share of ambient light that arrives.
    pub(crate) open: f32,
}

/// Three corners, the part and the material.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triangle {
    pub(crate) corners: [u32; 3],
    pub(crate) part: Part,
    pub(crate) material: u8,
    pub(crate) two_sided: bool,
}

/// A cross-section of a tube: an ellipse with half axes `a` and `b` (metres, not normalised).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ring {
    pub(crate) centre: V3,
    pub(crate) a: V3,
    pub(crate) b: V3,
    /// Texture coordinate along the tube.
    pub(crate) along: f32,
    pub(crate) material: u8,
    pub(crate) part: Part,
}

/// Triangles in `world`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Mesh {
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) triangles: Vec<Triangle>,
}

impl Mesh {
    pub(crate) fn clear(&mut self) {
        self.vertices.clear();
        self.triangles.clear();
    }

    fn push_vertex(&mut self, at: V3, tex: V3) -> u32 {
        let index = self.vertices.len() as u32;
        self.vertices.push(Vertex { at, normal: V3::zeros(), tex, open: 1.0 });
        index
    }

    fn push_triangle(&mut self, corners: [u32; 3], part: Part, material: u8) {
        self.triangles.push(Triangle { corners, part, material, two_sided: false });
    }

    /// Computes area-weighted normals of everything added since `first_vertex`, `first_triangle`, after turning the
    /// triangles outwards: a closed surface has positive volume.
    fn finish(&mut self, first_vertex: usize, first_triangle: usize) {
        let corner = |mesh: &Self, t: &Triangle, k: usize| mesh.vertices[t.corners[k] as usize].at;
        let origin = self.vertices[first_vertex].at;
        let volume: f32 = self.triangles[first_triangle..]
            .iter()
            .map(|t| {
                let [p, q, r] = [0, 1, 2].map(|k| corner(self, t, k) - origin);
                p.dot(&q.cross(&r))
            })
            .sum();
        for i in first_triangle..self.triangles.len() {
            if volume < 0.0 && !self.triangles[i].two_sided {
                self.triangles[i].corners.swap(1, 2);
            }
            let t = self.triangles[i];
            let [p, q, r] = [0, 1, 2].map(|k| corner(self, &t, k));
            let face = (q - p).cross(&(r - p));
            for index in t.corners {
                self.vertices[index as usize].normal += face;
            }
        }
        for v in &mut self.vertices[first_vertex..] {
            v.normal = unit(v.normal);
        }
    }

    /// A closed tube through `rings`; `sides` corners each. Parts and materials are those of the ring a band
    /// begins with.
    pub(crate) fn tube(&mut self, rings: &[Ring], sides: u32) {
        let (v0, t0) = (self.vertices.len(), self.triangles.len());
        for ring in rings {
            for s in 0..sides {
                let (sin, cos) = (s as f32 * TAU / sides as f32).sin_cos();
                let offset = ring.a * cos + ring.b * sin;
                let tex = V3::new(cos * ring.a.norm(), sin * ring.b.norm(), ring.along);
                self.push_vertex(ring.centre + offset, tex);
            }
        }
        let base = v0 as u32;
        for (k, ring) in rings.iter().enumerate().take(rings.len().saturating_sub(1)) {
            for s in 0..sides {
                let (p, q) = (base + k as u32 * sides + s, base + k as u32 * sides + (s + 1) % sides);
                self.push_triangle([p, q, q + sides], ring.part, ring.material);
                self.push_triangle([p, q + sides, p + sides], ring.part, ring.material);
            }
        }
        for (k, ring) in [(0, rings.first()), (rings.len() - 1, rings.last())] {
            if let Some(ring) = ring {
                let hub = self.push_vertex(ring.centre, V3::new(0.0, 0.0, ring.along));
                for s in 0..sides {
                    let p = base + k as u32 * sides + s;
                    let q = base + k as u32 * sides + (s + 1) % sides;
                    let corners = if k == 0 { [hub, q, p] } else { [hub, p, q] };
                    self.push_triangle(corners, ring.part, ring.material);
                }
            }
        }
        self.finish(v0, t0);
    }

    /// An ellipsoid-like surface: `shape` moves a point of the unit sphere to its place, in `world`.
    pub(crate) fn blob(
        &mut self,
        part: Part,
        material: u8,
        (around, down): (u32, u32),
        shape: impl Fn(V3) -> (V3, V3),
    ) {
        let (v0, t0) = (self.vertices.len(), self.triangles.len());
        for j in 0..=down {
            let (sin_j, cos_j) = (j as f32 / down as f32 * TAU / 2.0).sin_cos();
            for i in 0..around {
                let (sin_i, cos_i) = (i as f32 / around as f32 * TAU).sin_cos();
                let (at, tex) = shape(V3::new(sin_j * cos_i, sin_j * sin_i, cos_j));
                self.push_vertex(at, tex);
            }
        }
        let base = v0 as u32;
        for j in 0..down {
            for i in 0..around {
                let p = base + j * around + i;
                let q = base + j * around + (i + 1) % around;
                if j > 0 {
                    self.push_triangle([p, q + around, q], part, material);
                }
                if j + 1 < down {
                    self.push_triangle([p, p + around, q + around], part, material);
                }
            }
        }
        self.finish(v0, t0);
        // The pole rows hold one point many times; each copy takes the common normal.
        for row in [0, down] {
            let span = (v0 + (row * around) as usize)..(v0 + ((row + 1) * around) as usize);
            let sum: V3 = self.vertices[span.clone()].iter().map(|v| v.normal).sum();
            for v in &mut self.vertices[span] {
                v.normal = unit(sum);
            }
        }
    }

    /// A box with centre, half axes, and flat faces divided into `cells` x `cells`.
    pub(crate) fn cuboid(&mut self, part: Part, material: u8, centre: V3, half: [V3; 3], cells: u32) {
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let n = half[axis] * sign;
                let (u, v) = (half[(axis + 1) % 3] * sign, half[(axis + 2) % 3]);
                self.sheet(part, material, centre + n, u, v, (cells, cells), false);
            }
        }
    }

    /// A flat rectangle `centre ± u ± v`, facing `u x v`, divided into cells.
    #[expect(clippy::too_many_arguments, reason = "one shape, private to the scene")]
    pub(crate) fn sheet(
        &mut self,
        part: Part,
        material: u8,
        centre: V3,
        u: V3,
        v: V3,
        (columns, rows): (u32, u32),
        two_sided: bool,
    ) {
        let base = self.vertices.len() as u32;
        let normal = unit(u.cross(&v));
        for j in 0..=rows {
            for i in 0..=columns {
                let (x, y) = (2.0 * i as f32 / columns as f32 - 1.0, 2.0 * j as f32 / rows as f32 - 1.0);
                let at = centre + u * x + v * y;
                let index = self.push_vertex(at, at);
                self.vertices[index as usize].normal = normal;
            }
        }
        for j in 0..rows {
            for i in 0..columns {
                let p = base + j * (columns + 1) + i;
                let q = p + columns + 1;
                for corners in [[p, p + 1, q + 1], [p, q + 1, q]] {
                    self.triangles.push(Triangle { corners, part, material, two_sided });
                }
            }
        }
    }

    /// A grid of points already in place, `columns` wide; seen from both sides.
    pub(crate) fn cloth(&mut self, part: Part, material: u8, columns: usize, points: &[(V3, V3)]) {
        let (v0, t0) = (self.vertices.len(), self.triangles.len());
        for &(at, tex) in points {
            self.push_vertex(at, tex);
        }
        let rows = points.len() / columns;
        for j in 0..rows.saturating_sub(1) {
            for i in 0..columns.saturating_sub(1) {
                let p = (v0 + j * columns + i) as u32;
                let q = p + columns as u32;
                for corners in [[p, p + 1, q + 1], [p, q + 1, q]] {
                    self.triangles.push(Triangle { corners, part, material, two_sided: true });
                }
            }
        }
        self.finish(v0, t0);
    }
}
