//! A model of which nothing is known but its coordinates, inputs and sensors: what black boxes and naive predictions start from.

use lagrange::{Coordinate, Field, TextLagrangian, TextProblem, TextSource};
use toml_edit::{Array, Item, Table, value};

use super::Model;
use super::inputs::OF_LINK;
use crate::Error;

/// What is left of a model's file; the inputs only where the coordinates are driven.
const LEFT: [&str; 3] = ["name", "sensor", "log"];
const INPUT: &str = "input";

impl Model {
    /// The model without its mechanics: T = ½ Σ q̇², V = 0, no effects. Each coordinate goes on with the velocity that it has; with a network alone on
    /// all of them it is a black box, v̇ = Q_NN(q, v, u) ([`Options::alone`](crate::train::Options::alone)). `driven`: whether it keeps its inputs.
    ///
    /// # Errors
    /// [`Error::NoFormula`] when a coordinate has a name that no formula can have; [`Error::Floating`] when one is the pose of a floating body.
    pub fn without_mechanics(&self, driven: bool) -> Result<Model, Error> {
        let coordinates = self.mechanics.coordinates();
        crate::entries::refuse_poses(coordinates, "a model without mechanics")?;
        refuse_names(coordinates)?;
        let mut document = self.document()?;
        let table = document.as_table_mut();
        table.retain(|key, _| LEFT.contains(&key) || (driven && key == INPUT));
        // What pushed a link is seen by the network, as every input; that there is no link any more is nobody's business.
        let inputs = table.remove(INPUT).map(Item::into_array_of_tables);
        if let Some(Ok(mut inputs)) = inputs {
            let first = coordinates.first().map_or("", |c| c.name.as_str());
            for input in inputs.iter_mut() {
                if input.remove("link").is_some() {
                    input.retain(|key, _| !OF_LINK.contains(&key));
                    input.insert("joint", value(first));
                }
            }
            table.insert(INPUT, Item::ArrayOfTables(inputs));
        }
        let names = |keep: &dyn Fn(&Coordinate) -> bool| -> Array {
            let kept = coordinates.iter().filter(|c| keep(c));
            kept.map(|c| c.name.as_str()).collect()
        };
        let squares = coordinates.iter().map(|c| format!("{}_dot^2", c.name));
        let squares: Vec<String> = squares.collect();
        let mut lagrangian = Table::new();
        lagrangian.insert("coordinates", value(names(&|_| true)));
        lagrangian.insert("angles", value(names(&|c| c.angular)));
        let unwrapped = names(&|c| c.angular && !c.wraps);
        if !unwrapped.is_empty() {
            lagrangian.insert("unwrapped", value(unwrapped));
        }
        lagrangian.insert("kinetic", value(format!("0.5*({})", squares.join(" + "))));
        lagrangian.insert("potential", value("0"));
        table.insert("lagrangian", Item::Table(lagrangian));
        Model::parse(&self.path, document.to_string())
    }
}

/// Refuses names that no formula can have.
fn refuse_names(coordinates: &[Coordinate]) -> Result<(), Error> {
    for coordinate in coordinates {
        let alone = TextSource {
            coordinates: vec![coordinate.name.clone()],
            angles: Vec::new(),
            kinetic: "0".to_owned(),
            potential: "0".to_owned(),
            constraints: Vec::new(),
            parameters: Vec::new(),
        };
        let problems = TextLagrangian::new(&alone).err().unwrap_or_default();
        let of_name = |problem: &&TextProblem| matches!(problem.field, Field::Coordinates(_));
        if let Some(problem) = problems.iter().find(of_name) {
            return Err(Error::NoFormula {
                joint: coordinate.joint.clone(),
                what: problem.message.clone(),
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::*;
    use crate::hybrid::Hybrid;

    #[test]
    fn without_mechanics_everything_goes_on_as_it_moves() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
        let model = Model::load(&folder.join("paper_known.toml")).unwrap();
        for driven in [false, true] {
            let blank = model.without_mechanics(driven).unwrap();
            let names = |m: &Model| -> Vec<(String, bool)> {
                let coordinates = m.mechanics.coordinates();
                let of = coordinates.iter().map(|c| (c.name.clone(), c.wraps));
                of.collect()
            };
            assert_eq!(names(&blank), names(&model));
            assert_eq!(blank.inputs.len(), usize::from(driven));
            assert_eq!(blank.sensors, model.sensors);
            let hybrid = Hybrid::of(&blank);
            let rows = if driven {
                vec![vec![0.0; 3]]
            } else {
                Vec::new()
            };
            let theta = hybrid.theta();
            let inputs = hybrid.drive(&[0.0, 0.5, 1.0], &rows, 4, &theta, &[]);
            let mut out = crate::shooting::Trajectory::default();
            let start = [0.1, 3.0, -0.4, 2.0];
            crate::shooting::Roller::new(&hybrid, &[])
                .roll(&theta, &inputs, (0, 3), &start, &mut out)
                .unwrap();
            let last = &out.states[8..];
            let expected = [-0.3, 5.0, -0.4, 2.0];
            for (last, expected) in last.iter().zip(expected) {
                assert!((last - expected).abs() < 1e-12, "{last} {expected}");
            }
        }
    }

    #[test]
    fn an_input_that_pushed_a_link_is_one_all_the_same() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let path = models.join("cartpole/cartpole.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let rotor = "\n[[input]]\nname = \"rotor\"\nlink = \"pole\"\nforce = [1.0, 0.0, 0.0]\n";
        let names = |text: String| -> Vec<String> {
            let model = Model::parse(&path, text).unwrap();
            let blank = model.without_mechanics(true).unwrap();
            blank.inputs.iter().map(|i| i.name.clone()).collect()
        };
        assert_eq!(names(text + rotor), ["motor", "rotor"]);
        let in_a_line = "urdf = \"cartpole.urdf\"\ninput = [{ name = \"rotor\", link = \"pole\", torque = [0, 1, 0] }]\n";
        assert_eq!(names(in_a_line.to_owned()), ["rotor"]);
    }

    fn blank_of(name: &str) -> (Model, Result<Model, Error>) {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join(format!("{name}/{name}.toml"))).unwrap();
        let blank = model.without_mechanics(true);
        (model, blank)
    }

    /// Its joints turned round and round.
    #[test]
    fn joints_with_ends_stay_angles_that_do_not_wrap() {
        let (model, blank) = blank_of("arm7");
        let blank = blank.unwrap();
        let both = blank.mechanics.coordinates().iter();
        for (blank, given) in both.zip(model.mechanics.coordinates()) {
            assert!(given.angular && !given.wraps);
            assert_eq!((blank.angular, blank.wraps), (true, false));
        }
    }

    #[test]
    fn a_planar_joint_has_no_name_in_formulas() {
        let words = blank_of("mobile_arm").1.unwrap_err().to_string();
        assert!(words.contains("`drive.x` is not a name"), "{words}");
        assert!(words.contains("rename the joint `drive`"), "{words}");
    }
}
