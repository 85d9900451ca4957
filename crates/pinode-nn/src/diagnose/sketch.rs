//! A picture of the mechanism: its joints, links and masses at a typical moment of the log, seen from the side.

use lagrange::mechanism::{Joint, JointKind, Tree};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::smooth::Smoothed;
use crate::hybrid::Reading;

/// Configurations of the log that are looked at, at most.
const LOOKED_AT: usize = 400;
/// A motion whose scatter along the vertical is less than this part of its largest is seen from above.
const FLAT: f64 = 1e-4;

/// Points in the plane of the picture: to the right, up, m.
pub type Point = [f64; 2];

/// The mechanism in the plane in which it moves most.
#[derive(Debug, Clone, PartialEq)]
pub struct Sketch {
    /// From where it is seen, in words.
    pub view: String,
    /// The moment that is shown: index of the recording, time in s.
    pub moment: (usize, f64),
    /// The links: from each joint to the next, and to the centres of mass at the ends.
    pub links: Vec<[Point; 2]>,
    /// The joints that move.
    pub joints: Vec<SketchedJoint>,
    /// The centres of mass, with the bodies' names and masses in kg.
    pub masses: Vec<(Point, String, f64)>,
    /// Where the last body's centre of mass goes over the log, one a recording.
    pub paths: Vec<Vec<Point>>,
}

/// A joint of the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct SketchedJoint {
    /// Its name.
    pub name: String,
    /// Name of the coordinate that moves it.
    pub coordinate: String,
    /// Where it is.
    pub at: Point,
    /// Where it slides, from its least to its largest position in the log; none where it turns.
    pub rail: Option<[Point; 2]>,
}

/// The picture of a tree over a log; none where q of the tree is not what is measured.
pub fn sketch(
    tree: &Tree,
    smoothed: &[Smoothed],
    times: &[&[f64]],
    readings: &[Reading],
) -> Option<Sketch> {
    if tree.nq() != readings.len() || tree.is_floating() {
        return None;
    }
    let moments = moments(smoothed, readings);
    let typical = typical(&moments)?;
    let places = moments
        .iter()
        .map(|m| Places::of(tree, &m.q))
        .collect::<Option<Vec<_>>>()?;
    let now = places.get(typical)?;
    let view = View::of(tree, &places);
    let project = |x: &Vector3<f64>| [x.dot(&view.right), x.dot(&view.up)];
    let segment = |[a, b]: &[Vector3<f64>; 2]| [project(a), project(b)];

    let coordinates = tree.coordinates();
    let joints = tree
        .joints()
        .iter()
        .zip(&now.joints)
        .filter(|(joint, _)| joint.kind != JointKind::Fixed)
        .map(|(joint, at)| SketchedJoint {
            name: joint.name.clone(),
            coordinate: joint
                .coordinate
                .and_then(|c| coordinates.get(c))
                .map_or(String::new(), |c| c.name.clone()),
            at: project(at),
            rail: rail(tree, joint, &moments, typical).map(|r| segment(&r)),
        })
        .collect();
    let masses = tree
        .bodies()
        .iter()
        .zip(&now.centres)
        .map(|(body, at)| (project(at), body.name.clone(), body.mass))
        .collect();
    let mut paths: Vec<Vec<Point>> = vec![Vec::new(); smoothed.len()];
    for (moment, places) in moments.iter().zip(&places) {
        if let (Some(path), Some(end)) = (paths.get_mut(moment.run), places.centres.last()) {
            path.push(project(end));
        }
    }
    let moment = moments.get(typical)?;
    Some(Sketch {
        view: view.words,
        moment: (moment.run, *times.get(moment.run)?.get(moment.sample)?),
        links: now.links.iter().map(segment).collect(),
        joints,
        masses,
        paths,
    })
}

/// A configuration of the log.
struct Moment {
    run: usize,
    sample: usize,
    q: Vec<f64>,
}

fn moments(smoothed: &[Smoothed], readings: &[Reading]) -> Vec<Moment> {
    let length = |s: &Smoothed| s.q.first().map_or(0, Vec::len);
    let all: usize = smoothed.iter().map(length).sum();
    let stride = all.div_ceil(LOOKED_AT).max(1);
    let of = |(run, s): (usize, &Smoothed)| {
        let q = |k: usize| {
            let state = s.state(k);
            let read =
                |(c, r): (usize, &Reading)| r.position_of(state[c], state[readings.len() + c]);
            readings.iter().enumerate().map(read).collect()
        };
        let each = (0..length(s)).step_by(stride);
        let moments = each.map(|sample| (sample, q(sample)));
        moments
            .map(|(sample, q)| Moment { run, sample, q })
            .collect::<Vec<_>>()
    };
    smoothed.iter().enumerate().flat_map(of).collect()
}

/// The configuration nearest to the coordinates' medians, each in units of its range.
fn typical(moments: &[Moment]) -> Option<usize> {
    let n = moments.first()?.q.len();
    let scale: Vec<(f64, f64)> = (0..n)
        .map(|c| {
            let mut values: Vec<f64> = moments.iter().map(|m| m.q[c]).collect();
            let middle = super::audit::median(&mut values);
            let range = values
                .last()
                .zip(values.first())
                .map_or(0.0, |(b, a)| b - a);
            (middle, if range > 0.0 { range } else { 1.0 })
        })
        .collect();
    let away = |m: &Moment| -> f64 {
        let parts = m.q.iter().zip(&scale);
        parts
            .map(|(q, (middle, range))| ((q - middle) / range).powi(2))
            .sum()
    };
    (0..moments.len()).min_by(|&a, &b| away(&moments[a]).total_cmp(&away(&moments[b])))
}

/// Where everything is, in the world.
struct Places {
    joints: Vec<Vector3<f64>>,
    links: Vec<[Vector3<f64>; 2]>,
    centres: Vec<Vector3<f64>>,
}

impl Places {
    fn of(tree: &Tree, q: &[f64]) -> Option<Self> {
        let poses = tree.link_poses(q).ok()?;
        let pose = |name: &str| {
            let link = tree.links().iter().position(|l| l.name == name)?;
            poses.get(link)
        };
        let origin = |name: &str| Some(pose(name)?.translation.vector);
        let mut places = Places {
            joints: Vec::new(),
            links: Vec::new(),
            centres: Vec::new(),
        };
        for joint in tree.joints() {
            // What slides leaves its place on the parent; what turns stays there.
            let child = origin(&joint.child)?;
            let foot = pose(&joint.parent)? * joint.origin.pose();
            places.joints.push(child);
            places
                .links
                .push([origin(&joint.parent)?, foot.translation.vector]);
        }
        for body in tree.bodies() {
            let centre = pose(&body.name)? * nalgebra::Point3::from(body.centre);
            places.centres.push(centre.coords);
            let carries = |j: &Joint| body.links.contains(&j.parent);
            if !tree.joints().iter().any(carries) {
                places.links.push([origin(&body.name)?, centre.coords]);
            }
        }
        places.links.retain(|[a, b]| (a - b).norm() > 1e-9);
        Some(places)
    }
}

/// Where a joint slides at its parent's place of the moment shown.
fn rail(
    tree: &Tree,
    joint: &Joint,
    moments: &[Moment],
    typical: usize,
) -> Option<[Vector3<f64>; 2]> {
    if joint.kind != JointKind::Prismatic {
        return None;
    }
    let poses = tree.link_poses(&moments.get(typical)?.q).ok()?;
    let parent = tree.links().iter().position(|l| l.name == joint.parent)?;
    let frame = poses.get(parent)? * joint.origin.pose();
    let place: usize = tree.coordinates()[..joint.coordinate?]
        .iter()
        .map(|c| c.nq())
        .sum();
    let at = moments
        .iter()
        .map(|m| joint.ratio * m.q[place] + joint.offset);
    let least = at.clone().fold(f64::INFINITY, f64::min);
    let largest = at.fold(f64::NEG_INFINITY, f64::max);
    Some([least, largest].map(|s| (frame * nalgebra::Point3::from(s * joint.axis)).coords))
}

/// The plane of the picture.
struct View {
    right: Vector3<f64>,
    up: Vector3<f64>,
    words: String,
}

impl View {
    /// The vertical plane, against gravity, along which the joints and masses move most; from above where they stay at their height.
    fn of(tree: &Tree, places: &[Places]) -> Self {
        let gravity = Vector3::from(tree.gravity());
        let vertical = match gravity.norm() > 0.0 {
            true => -gravity.normalize(),
            false => Vector3::z(),
        };
        let moving = scatter(places.iter().map(|p| p.joints.iter().chain(&p.centres)));
        // What stands still has an extent: it decides where the motion leaves the plane open.
        let extent: Matrix3<f64> = places
            .iter()
            .flat_map(|p| &p.links)
            .map(|[a, b]| (b - a) * (b - a).transpose())
            .sum::<Matrix3<f64>>()
            / places.len().max(1) as f64;
        let largest = moving.trace().max(f64::MIN_POSITIVE);
        let height = vertical.dot(&(moving * vertical)) + vertical.dot(&(extent * vertical));
        let seen = moving + 1e-3 * extent;
        let level = Matrix3::identity() - vertical * vertical.transpose();
        let along = SymmetricEigen::new(level * seen * level);
        let order = along.eigenvalues.imax();
        let horizontal = along.eigenvectors.column(order).into_owned();
        let right = match along.eigenvalues[order] > 0.0 {
            true => positive(horizontal),
            false => positive(level * any_other(&vertical)),
        };
        if height < FLAT * largest {
            return View {
                right,
                up: positive(vertical.cross(&right)),
                words: "seen from above".to_owned(),
            };
        }
        View {
            right,
            up: vertical,
            words: "seen from the side, gravity pulls down".to_owned(),
        }
    }
}

/// Σ (x − mean)(x − mean)ᵀ of every point over the configurations, over their number.
fn scatter<'a>(
    configurations: impl Iterator<Item = impl Iterator<Item = &'a Vector3<f64>>>,
) -> Matrix3<f64> {
    let mut n = 0.0;
    let mut sums: Vec<(Vector3<f64>, Matrix3<f64>)> = Vec::new();
    for points in configurations {
        n += 1.0;
        for (k, x) in points.enumerate() {
            if k == sums.len() {
                sums.push((Vector3::zeros(), Matrix3::zeros()));
            }
            if let Some((sum, squares)) = sums.get_mut(k) {
                *sum += x;
                *squares += x * x.transpose();
            }
        }
    }
    let n = f64::max(n, 1.0);
    let of =
        |(sum, squares): &(Vector3<f64>, Matrix3<f64>)| (squares - sum * sum.transpose() / n) / n;
    sums.iter().map(of).sum()
}

/// Of length 1, with its largest component positive.
fn positive(x: Vector3<f64>) -> Vector3<f64> {
    let largest = x[x.icamax()];
    x.normalize() * largest.signum()
}

/// A direction that is not along this one.
fn any_other(x: &Vector3<f64>) -> Vector3<f64> {
    match x.x.abs() < 0.9 {
        true => Vector3::x(),
        false => Vector3::y(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::hybrid::Hybrid;
    use crate::model::Model;

    fn swings(coordinates: usize, reach: f64) -> Smoothed {
        let column = |c: usize| -> Vec<f64> {
            let phase = |k: usize| 0.1 * (k * (c + 1)) as f64;
            (0..500).map(|k| reach * phase(k).sin()).collect()
        };
        let columns: Vec<Vec<f64>> = (0..coordinates).map(column).collect();
        Smoothed {
            v: vec![vec![0.0; 500]; coordinates],
            a: vec![vec![0.0; 500]; coordinates],
            q: columns,
        }
    }

    fn of(name: &str) -> (Model, Sketch) {
        let path = format!(
            "{}/../../models/{name}/{name}.toml",
            env!("CARGO_MANIFEST_DIR")
        );
        let model = Model::load(Path::new(&path)).unwrap();
        let hybrid = Hybrid::of(&model);
        let readings = hybrid.readings(&hybrid.theta(), &[]);
        let log = swings(hybrid.nv(), 0.2);
        let t: Vec<f64> = (0..500).map(|k| 0.01 * f64::from(k)).collect();
        let sketch = sketch(model.tree.as_ref().unwrap(), &[log], &[&t], &readings).unwrap();
        (model, sketch)
    }

    #[test]
    fn a_cart_slides_on_its_rail_to_the_right_and_its_pole_stands_up() {
        let (_, sketch) = of("cartpole");
        assert!(sketch.view.contains("side"));
        let slider = &sketch.joints[0];
        let [from, to] = slider.rail.unwrap();
        assert!((from[0] + 0.2).abs() < 1e-3 && (to[0] - 0.2).abs() < 1e-3);
        assert_eq!((from[1], to[1]), (0.0, 0.0));
        // From the cart to the tip of the pole, 0.201 m.
        let length = |[a, b]: &[Point; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
        let pole = sketch
            .links
            .iter()
            .find(|l| (length(l) - 0.201).abs() < 1e-9);
        let [foot, tip] = pole.unwrap();
        assert!(tip[1] - foot[1] > 0.19, "{pole:?}");
        assert!((foot[0] - slider.at[0]).abs() < 1e-12);
        assert!(sketch.joints[1].rail.is_none());
    }

    #[test]
    fn the_arm_of_a_furuta_pendulum_is_above_its_pendulum() {
        let (_, sketch) = of("furuta_pendulum");
        let lowest = |p: &Point| p[1];
        let pendulum = sketch.masses.iter().find(|m| m.1 == "pendulum").unwrap();
        let arm = sketch.masses.iter().find(|m| m.1 == "arm").unwrap();
        assert!(lowest(&arm.0) > lowest(&pendulum.0) + 0.1);
    }
}
