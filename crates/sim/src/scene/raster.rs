//! Depth-buffered triangle rasteriser.
//!
//! Works on any projection in which inverse depth is affine over the screen: pinhole views store `1 / depth`, light
//! views minus the distance along the light. The larger value is the nearer surface.

use super::mesh::Triangle;

/// A projected corner: position in samples and nearness.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Screen {
    pub(crate) x: f32,
    pub(crate) y: f32,
    /// Grows towards the viewer; NaN marks a corner that cannot be projected.
    pub(crate) near: f32,
}

impl Screen {
    pub(crate) const NOWHERE: Self = Self { x: 0.0, y: 0.0, near: f32::NAN };
}

/// Which way round a triangle runs that faces the viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum View {
    /// A picture: y points down, so faces run clockwise in mathematical orientation.
    Picture,
    /// A light's map: y points up.
    Light,
}

impl View {
    fn front(self) -> f32 {
        match self {
            Self::Picture => -1.0,
            Self::Light => 1.0,
        }
    }
}

/// Columns and rows of samples; `right` and `bottom` are excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) right: usize,
    pub(crate) bottom: usize,
}

impl Window {
    /// Smallest window of a buffer that holds all corners.
    pub(crate) fn about(corners: &[Screen], width: usize, height: usize) -> Self {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for c in corners.iter().filter(|c| c.near.is_finite()) {
            low = [low[0].min(c.x), low[1].min(c.y)];
            high = [high[0].max(c.x), high[1].max(c.y)];
        }
        let inside = |x: f32, most: usize| (x.max(0.0) as usize).min(most);
        Self {
            left: inside(low[0], width),
            top: inside(low[1], height),
            right: inside(high[0] + 2.0, width),
            bottom: inside(high[1] + 2.0, height),
        }
    }

    /// Smallest window that holds both.
    pub(crate) fn join(self, other: Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }
}

/// Nearness and triangle number per sample; number 0 is free for "nothing drawn here".
#[derive(Debug, Clone)]
pub(crate) struct Buffer {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) near: Vec<f32>,
    pub(crate) owner: Vec<u32>,
}

impl Buffer {
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self { width, height, near: vec![f32::NEG_INFINITY; width * height], owner: vec![0; width * height] }
    }

    pub(crate) fn clear(&mut self) {
        self.near.fill(f32::NEG_INFINITY);
        self.owner.fill(0);
    }

    /// Sets a window back to the depths of `still` and no owner.
    pub(crate) fn restore(&mut self, still: &[f32], window: Window) {
        for row in window.top..window.bottom {
            let line = row * self.width + window.left..row * self.width + window.right.max(window.left);
            self.near[line.clone()].copy_from_slice(&still[line.clone()]);
            self.owner[line].fill(0);
        }
    }

    /// Draws all triangles; triangle `i` writes owner `i + 1`. One-sided triangles that face away are left out.
    pub(crate) fn draw(&mut self, triangles: &[Triangle], corners: &[Screen], view: View) {
        let front = view.front();
        for (i, t) in triangles.iter().enumerate() {
            let (a, b, c) =
                (corners[t.corners[0] as usize], corners[t.corners[1] as usize], corners[t.corners[2] as usize]);
            let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            let hidden = !t.two_sided && area * front <= 0.0;
            if hidden || !(a.near + b.near + c.near).is_finite() || area.abs() < 1e-6 {
                continue;
            }
            self.fill(a, b, c, area, i as u32 + 1);
        }
    }

    fn fill(&mut self, a: Screen, b: Screen, c: Screen, area: f32, owner: u32) {
        let low = |p: f32, q: f32, r: f32| p.min(q).min(r);
        let high = |p: f32, q: f32, r: f32| p.max(q).max(r);
        let top = up(low(a.y, b.y, c.y).max(0.0));
        let bottom = down(high(a.y, b.y, c.y).min(self.height as f32 - 1.0));
        let left = up(low(a.x, b.x, c.x).max(0.0));
        let right = down(high(a.x, b.x, c.x).min(self.width as f32 - 1.0));
        if !(top <= bottom && left <= right) {
            return;
        }
        let inverse = 1.0 / area;
        // Nearness is affine: near(x, y) = a.near + dx (x - a.x) + dy (y - a.y).
        let dx = ((b.near - a.near) * (c.y - a.y) - (c.near - a.near) * (b.y - a.y)) * inverse;
        let dy = ((c.near - a.near) * (b.x - a.x) - (b.near - a.near) * (c.x - a.x)) * inverse;
        let sign = area.signum();
        // Edge functions, positive inside: e(x, y) = ex x + ey y + e0.
        let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| {
            let (ex, ey) = (-(q.y - p.y) * sign, (q.x - p.x) * sign);
            (ex, ey, -(ex * p.x + ey * p.y))
        });
        for row in top as usize..=bottom as usize {
            let y = row as f32;
            let (mut first, mut last) = (left, right);
            let mut empty = false;
            for (ex, ey, e0) in edges {
                let rest = ey * y + e0;
                if ex > 1e-9 {
                    first = up(first.max(-rest / ex));
                } else if ex < -1e-9 {
                    last = down(last.min(-rest / ex));
                } else if rest < 0.0 {
                    empty = true;
                }
            }
            if empty || first > last {
                continue;
            }
            let start = row * self.width;
            let (first, last) = (first as usize, last as usize);
            let mut near = a.near + dx * (first as f32 - a.x) + dy * (y - a.y);
            let depths = &mut self.near[start + first..=start + last];
            let owners = &mut self.owner[start + first..=start + last];
            for (depth, slot) in depths.iter_mut().zip(owners) {
                if near > *depth {
                    *depth = near;
                    *slot = owner;
                }
                near += dx;
            }
        }
    }
}

/// Smallest integer not below `x`, for `-1e6 < x < 1e6`. Without the SSE4.1 instruction `ceil` is a library call, which
/// costs as much as the rest of a row.
fn up(x: f32) -> f32 {
    let whole = x as i32 as f32;
    if whole < x { whole + 1.0 } else { whole }
}

/// Largest integer not above `x`, as [`up`].
fn down(x: f32) -> f32 {
    let whole = x as i32 as f32;
    if whole > x { whole - 1.0 } else { whole }
}

/// Weights of the three corners at a sample, corrected for perspective when `perspective`.
pub(crate) fn weights(corners: [Screen; 3], x: f32, y: f32) -> [f32; 3] {
    let [a, b, c] = corners;
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    let wb = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area;
    let wc = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
    let [pa, pb, pc] = [(1.0 - wb - wc) * a.near, wb * b.near, wc * c.near];
    let total = pa + pb + pc;
    [pa / total, pb / total, pc / total]
}
