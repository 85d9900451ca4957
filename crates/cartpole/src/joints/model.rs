//! The model that the user of such a rig has: that of `models`, without the hidden friction.

use std::path::{Path, PathBuf};

use super::{Bench, Fault};
use crate::rig::{Error, write_whole};

impl Bench {
    /// Writes the user's model to `out_dir/model.toml`, with its URDF beside it, and returns the model's path.
    ///
    /// Viscous and Coulomb friction stand in the URDF: where one is hidden it is 0 there. Behind asymmetric and Stribeck friction the law
    /// is hidden, so the plain friction stays.
    ///
    /// # Errors
    /// Where a file cannot be read or written, or the URDF has not the joint's friction.
    pub fn known_model(&self, faults: &[Fault], out_dir: &Path) -> Result<PathBuf, Error> {
        let read = |path: &Path| std::fs::read_to_string(path).map_err(Error::io(path));
        let (model, mut urdf) = (read(&self.model)?, read(&self.urdf)?);
        for fault in faults {
            let attribute = match fault.kind {
                "viscous_friction" => Some("damping"),
                "coulomb_friction" => Some("friction"),
                _ => None,
            };
            if let Some(attribute) = attribute {
                let joint = self.target_name(fault);
                urdf = without(&urdf, joint, attribute).ok_or_else(|| Error::Model {
                    path: self.urdf.clone(),
                    reason: format!("joint `{joint}` has no <dynamics {attribute}=\"…\">"),
                })?;
            }
        }
        std::fs::create_dir_all(out_dir).map_err(Error::io(out_dir))?;
        let name = self.urdf.file_name().unwrap_or_default();
        write_whole(&out_dir.join(name), urdf.as_bytes())?;
        let path = out_dir.join("model.toml");
        write_whole(&path, model.as_bytes())?;
        Ok(path)
    }
}

/// The URDF with 0 for the `attribute` of the <dynamics> of a joint.
fn without(urdf: &str, joint: &str, attribute: &str) -> Option<String> {
    let start = urdf.find(&format!("<joint name=\"{joint}\""))?;
    let end = start + urdf.get(start..)?.find("</joint>")?;
    let dynamics = start + urdf.get(start..end)?.find("<dynamics")?;
    let key = format!(" {attribute}=\"");
    let value = dynamics + urdf.get(dynamics..end)?.find(&key)? + key.len();
    let close = value + urdf.get(value..end)?.find('"')?;
    Some(format!("{}0{}", urdf.get(..value)?, urdf.get(close..)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_friction_of_the_named_joint_goes() {
        let urdf = r#"<joint name="a"><dynamics damping="1" friction="2"/></joint>
            <joint name="b"><dynamics damping="3" friction="4"/></joint>"#;
        let changed = without(urdf, "b", "damping").unwrap();
        assert_eq!(changed, urdf.replace("\"3\"", "\"0\""));
        let changed = without(urdf, "a", "friction").unwrap();
        assert_eq!(changed, urdf.replace("\"2\"", "\"0\""));
        assert_eq!(without(urdf, "c", "damping"), None);
    }
}
