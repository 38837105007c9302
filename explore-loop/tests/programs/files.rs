//! Files for the programs to read.

use std::f64::consts::PI;
use std::fmt::Write;
use std::path::PathBuf;

use dvrk_io::session::SessionWriter;
use explore_loop::cell::sim::Scene;
use explore_loop::mesh::{Mesh, Options};
use explore_loop::nalgebra::{Isometry3, Point3, Vector3};

/// A folder with every file that a call names.
pub struct Files(tempfile::TempDir);

impl Files {
    pub fn make() -> Self {
        let files = Self(tempfile::tempdir().unwrap());
        let ball = ball();
        let normals = ball.iter().map(|p| p.coords.normalize()).collect();
        let cloud = Mesh::new(ball.clone()).unwrap().with_normals(normals);
        files.save("ball.ply", &cloud.unwrap());
        let body = Scene::ellipsoid([0.06, 0.045, 0.03]).unwrap();
        let body = body.mesh();
        let triangles = body.triangles.iter().map(|t| t.map(|v| v as u32)).collect();
        let mesh = Mesh::new(body.vertices.clone()).unwrap();
        files.save("cushion.obj", &mesh.with_triangles(triangles).unwrap());
        files.sheets();
        files.surface();
        let mut table = String::new();
        for k in 0..25 {
            let (x, y) = (0.01 * f64::from(k % 5), 0.01 * f64::from(k / 5));
            writeln!(table, "{x},{y},0,0,0,{x}").unwrap();
        }
        files.put("nodes.csv", &table);
        files.put("points.csv", "0.02,0.02,0\n");
        files.session(&ball);
        files
    }

    /// The words of a call, with the files of this folder.
    pub fn call(&self, words: &[&str]) -> Vec<String> {
        let word = |word: &&str| {
            if word.starts_with("OUT") || self.path(word).exists() {
                self.path(word).to_str().unwrap().to_owned()
            } else {
                (*word).to_owned()
            }
        };
        words.iter().map(word).collect()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn save(&self, name: &str, mesh: &Mesh) {
        mesh.save(&self.path(name), Options::default()).unwrap();
    }

    /// A wavy sheet half a metre before the camera, and the same bent; alone, and as a folder of pairs.
    fn sheets(&self) {
        let point = |k: usize| {
            let (x, y) = (0.002 * (k % 50) as f64, 0.002 * (k / 50) as f64);
            Point3::new(x, y, 0.5 + 0.004 * (90.0 * x).sin() * (80.0 * y).cos())
        };
        let before: Vec<Point3<f64>> = (0..2500).map(point).collect();
        let bent = |p: &Point3<f64>| Point3::new(p.x, p.y, p.z - 0.4 * p.x * p.x);
        let [before, after] = [before.clone(), before.iter().map(bent).collect()]
            .map(|points| Mesh::new(points).unwrap());
        self.save("before.ply", &before);
        self.save("after.ply", &after);
        std::fs::create_dir_all(self.path("pairs/one_M5")).unwrap();
        self.save("pairs/one_M5/source.ply", &before);
        self.save("pairs/one_M5/target.ply", &after);
        self.save("pairs/one_M5/truth.ply", &after);
    }

    /// A sheet that is seen to rise.
    fn surface(&self) {
        let (side, step) = (6u32, 0.01);
        let place = |k: u32| [f64::from(k % side) * step, f64::from(k / side) * step];
        let points = (0..side * side).map(|k| Point3::new(place(k)[0], place(k)[1], 0.02));
        let triangles = (0..(side - 1) * side).filter(|k| k % side < side - 1);
        let triangles =
            triangles.flat_map(|k| [[k, k + 1, k + side], [k + 1, k + side + 1, k + side]]);
        let mesh = Mesh::new(points.collect()).unwrap();
        self.save(
            "sheet.ply",
            &mesh.with_triangles(triangles.collect()).unwrap(),
        );
        let mut table = String::from("frame,vertex,x,y,z\n");
        for (frame, vertex) in (0..3).flat_map(|f| (0..12).map(move |v| (f, v))) {
            let [x, y] = place(vertex);
            writeln!(
                table,
                "{frame},{vertex},{x},{y},{}",
                0.02 + 0.001 * f64::from(frame)
            )
            .unwrap();
        }
        self.put("seen.csv", &table);
    }

    /// What a camera above sees of a ball that lies still, with the truth and an arm that stands by.
    fn session(&self, ball: &[Point3<f64>]) {
        let mut session = SessionWriter::create(self.path("session.mcap")).unwrap();
        session.table(0.0, &-Vector3::z_axis(), 0.55).unwrap();
        let camera = |p: &Point3<f64>| Point3::new(p.x, -p.y, 0.5 - p.z);
        let seen: Vec<Point3<f64>> = ball.iter().filter(|p| p.z > 0.01).map(camera).collect();
        let truth: Vec<Point3<f64>> = ball.iter().map(camera).collect();
        for frame in 0..4 {
            let stamp = 0.05 * f64::from(frame);
            session.points(stamp, &seen).unwrap();
            session.truth(stamp, &truth).unwrap();
            let tip = Isometry3::translation(0.3, 0.0, 0.3);
            session.pose(stamp, "PSM1", &tip).unwrap();
            session.jaw(stamp, "PSM1", 0.8).unwrap();
        }
        session.finish().unwrap();
    }
}

/// 600 points 7.24 mm apart on a sphere of 50 mm: a spiral.
fn ball() -> Vec<Point3<f64>> {
    let point = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 600.0;
        let (a, s) = (
            PI * (1.0 + 5f64.sqrt()) * f64::from(i),
            (1.0 - z * z).sqrt(),
        );
        Point3::new(0.05 * s * a.cos(), 0.05 * s * a.sin(), 0.05 * z)
    };
    (0..600).map(point).collect()
}
