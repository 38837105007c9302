//! Pictures of a model from six sides, as PNG: a small z-buffer renderer.
//!
//! A picture of the model after every manipulation shows at once what numbers hide: doubled sheets, misplaced layers, holes.
//! Views are orthographic along ±x, ±y, ±z of the given points, in one image of 3 × 2 panels.

use super::colour::Rgb;
use nalgebra::{Point3, Vector3};
use std::io;
use std::path::Path;

/// A coloured mesh or cloud to draw.
#[derive(Debug, Clone, Copy)]
pub struct Drawing<'a> {
    /// Positions, any unit.
    pub points: &'a [Point3<f64>],
    /// Triangles; vertices without one are drawn as dots.
    pub triangles: &'a [[u32; 3]],
    /// Colour of each point.
    pub colours: &'a [Rgb],
}

/// Colour of the back of a face, seen through a hole in the front.
const INSIDE: Rgb = [205, 120, 110];
const PANEL: usize = 420;

struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    depth: Vec<f64>,
}

/// A view: screen axes and viewing direction.
struct View {
    right: Vector3<f64>,
    up: Vector3<f64>,
    into: Vector3<f64>,
}

/// Renders six views and writes them to `path`.
///
/// # Errors
/// The file cannot be written.
pub fn write_six_views(path: &Path, drawing: &Drawing<'_>) -> io::Result<()> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    // The camera frame has +z away from the camera, so "top" looks along +z.
    let views = [
        View {
            right: x,
            up: -y,
            into: z,
        },
        View {
            right: -x,
            up: -y,
            into: -z,
        },
        View {
            right: x,
            up: -z,
            into: -y,
        },
        View {
            right: -x,
            up: -z,
            into: y,
        },
        View {
            right: y,
            up: -z,
            into: x,
        },
        View {
            right: -y,
            up: -z,
            into: -x,
        },
    ];
    let mut canvas = Canvas::new(3 * PANEL, 2 * PANEL);
    let (centre, scale) = frame(drawing.points);
    for (k, view) in views.iter().enumerate() {
        let origin = [(k / 2) * PANEL + PANEL / 2, (k % 2) * PANEL + PANEL / 2];
        let project = |p: &Point3<f64>| {
            let d = p - centre;
            [
                origin[0] as f64 + scale * d.dot(&view.right),
                origin[1] as f64 - scale * d.dot(&view.up),
                d.dot(&view.into),
            ]
        };
        canvas.draw(drawing, &project, &view.into);
    }
    canvas.save(path)
}

/// Centre of the bounding box, and the scale that fits it into a panel.
fn frame(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let low = points
        .iter()
        .fold(Point3::from([f64::INFINITY; 3]), |a, p| a.inf(p));
    let high = points
        .iter()
        .fold(Point3::from([f64::NEG_INFINITY; 3]), |a, p| a.sup(p));
    if points.is_empty() {
        return (Point3::origin(), 1.0);
    }
    let extent = (high - low).amax().max(1e-9);
    (nalgebra::center(&low, &high), 0.92 * PANEL as f64 / extent)
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![[250; 3]; width * height],
            depth: vec![f64::INFINITY; width * height],
        }
    }

    fn draw(
        &mut self,
        drawing: &Drawing<'_>,
        project: &dyn Fn(&Point3<f64>) -> [f64; 3],
        into: &Vector3<f64>,
    ) {
        let mut meshed = vec![false; drawing.points.len()];
        for t in drawing.triangles {
            for i in t {
                meshed[*i as usize] = true;
            }
            let corners = t.map(|i| drawing.points[i as usize]);
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let lit = -normal.dot(into) / normal.norm().max(1e-300);
            let mean: [u32; 3] = std::array::from_fn(|c| {
                t.iter()
                    .map(|i| u32::from(drawing.colours[*i as usize][c]))
                    .sum()
            });
            let base = if lit < 0.0 {
                INSIDE
            } else {
                mean.map(|m| (m / 3) as u8)
            };
            let shade = 0.45 + 0.55 * lit.abs();
            self.triangle(
                corners.map(|p| project(&p)),
                base.map(|c| (f64::from(c) * shade) as u8),
            );
        }
        for (i, point) in drawing
            .points
            .iter()
            .enumerate()
            .filter(|(i, _)| !meshed[*i])
        {
            let [x, y, z] = project(point);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    self.put(x as i64 + dx, y as i64 + dy, z, drawing.colours[i]);
                }
            }
        }
    }

    fn triangle(&mut self, [a, b, c]: [[f64; 3]; 3], colour: Rgb) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-12 {
            return;
        }
        let range = |k: usize| {
            let low = a[k].min(b[k]).min(c[k]).floor() as i64;
            low..=(a[k].max(b[k]).max(c[k]).ceil() as i64)
        };
        for y in range(1) {
            for x in range(0) {
                let (px, py) = (x as f64, y as f64);
                let u = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area;
                let v = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area;
                let w = 1.0 - u - v;
                if u >= -1e-9 && v >= -1e-9 && w >= -1e-9 {
                    self.put(x, y, u * a[2] + v * b[2] + w * c[2], colour);
                }
            }
        }
    }

    fn put(&mut self, x: i64, y: i64, depth: f64, colour: Rgb) {
        if x < 0 || y < 0 || x as usize >= self.width || y as usize >= self.height {
            return;
        }
        let at = y as usize * self.width + x as usize;
        if depth < self.depth[at] {
            self.depth[at] = depth;
            self.pixels[at] = colour;
        }
    }

    fn save(&self, path: &Path) -> io::Result<()> {
        let file = io::BufWriter::new(std::fs::File::create(path)?);
        let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer
            .write_image_data(self.pixels.as_flattened())
            .map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)
    }
}
