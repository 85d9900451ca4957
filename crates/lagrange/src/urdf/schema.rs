//! The elements of URDF that concern links and joints, their attributes and their numbers.

use super::report::shown;

/// An attribute that an element may have.
pub struct Field {
    pub name: &'static str,
    /// How many numbers it holds; 0 for text.
    pub numbers: usize,
    pub required: bool,
    /// Whether an infinite number has a meaning.
    pub unbounded: bool,
}

const fn number(name: &'static str) -> Field {
    numbers(name, 1)
}
const fn numbers(name: &'static str, numbers: usize) -> Field {
    Field {
        name,
        numbers,
        required: false,
        unbounded: false,
    }
}
const fn text(name: &'static str) -> Field {
    numbers(name, 0)
}
const fn required(field: Field) -> Field {
    Field {
        required: true,
        ..field
    }
}
const fn unbounded(field: Field) -> Field {
    Field {
        unbounded: true,
        ..field
    }
}

/// The attributes of the elements within links and joints.
pub fn fields(element: &str, newer: bool) -> Option<&'static [Field]> {
    Some(match element {
        "link" => const { &[required(text("name")), text("type")] },
        "joint" => const { &[required(text("name")), required(text("type"))] },
        "inertial" | "geometry" => &[],
        "visual" | "collision" => const { &[text("name"), text("group")] },
        "origin" => {
            const {
                &[
                    numbers("xyz", 3),
                    numbers("rpy", 3),
                    numbers("quat_xyzw", 4),
                ]
            }
        }
        "mass" => const { &[required(number("value"))] },
        "inertia" => {
            const {
                &[
                    required(number("ixx")),
                    required(number("ixy")),
                    required(number("ixz")),
                    required(number("iyy")),
                    required(number("iyz")),
                    required(number("izz")),
                ]
            }
        }
        "parent" | "child" => const { &[required(text("link"))] },
        "axis" => const { &[required(numbers("xyz", 3))] },
        "limit" if newer => {
            const {
                &[
                    unbounded(number("lower")),
                    unbounded(number("upper")),
                    unbounded(number("effort")),
                    unbounded(number("velocity")),
                    unbounded(number("acceleration")),
                    unbounded(number("deceleration")),
                    unbounded(number("jerk")),
                ]
            }
        }
        "limit" => {
            const {
                &[
                    unbounded(number("lower")),
                    unbounded(number("upper")),
                    unbounded(number("effort")),
                    required(unbounded(number("velocity"))),
                    text("acceleration"),
                    text("deceleration"),
                    text("jerk"),
                ]
            }
        }
        "dynamics" => const { &[number("damping"), number("friction")] },
        "mimic" => {
            const {
                &[
                    required(text("joint")),
                    number("multiplier"),
                    number("offset"),
                ]
            }
        }
        "calibration" => const { &[number("rising"), number("falling")] },
        "safety_controller" => {
            const {
                &[
                    unbounded(number("soft_lower_limit")),
                    unbounded(number("soft_upper_limit")),
                    number("k_position"),
                    required(number("k_velocity")),
                ]
            }
        }
        "box" => const { &[required(numbers("size", 3))] },
        "cylinder" | "capsule" => {
            const { &[required(number("radius")), required(number("length"))] }
        }
        "sphere" => const { &[required(number("radius"))] },
        "mesh" => const { &[required(text("filename")), numbers("scale", 3)] },
        "material" => const { &[required(text("name"))] },
        "color" => const { &[required(numbers("rgba", 4))] },
        "texture" => const { &[required(text("filename"))] },
        _ => return None,
    })
}

/// How often a child element may stand in its parent.
pub enum Times {
    Once,
    AtMostOnce,
    Any,
}

/// The elements that may stand in an element.
pub fn children(element: &str) -> &'static [(&'static str, Times)] {
    use Times::{Any, AtMostOnce, Once};
    match element {
        "link" => &[
            ("inertial", AtMostOnce),
            ("visual", Any),
            ("collision", Any),
        ],
        "inertial" => &[("origin", AtMostOnce), ("mass", Once), ("inertia", Once)],
        "visual" => &[
            ("origin", AtMostOnce),
            ("geometry", Once),
            ("material", AtMostOnce),
        ],
        "collision" => &[("origin", AtMostOnce), ("geometry", Once)],
        "geometry" => &[
            ("box", AtMostOnce),
            ("cylinder", AtMostOnce),
            ("capsule", AtMostOnce),
            ("sphere", AtMostOnce),
            ("mesh", AtMostOnce),
        ],
        "material" => &[("color", AtMostOnce), ("texture", AtMostOnce)],
        "joint" => &[
            ("origin", AtMostOnce),
            ("parent", Once),
            ("child", Once),
            ("axis", AtMostOnce),
            ("limit", AtMostOnce),
            ("dynamics", AtMostOnce),
            ("mimic", AtMostOnce),
            ("calibration", AtMostOnce),
            ("safety_controller", AtMostOnce),
        ],
        _ => &[],
    }
}

/// What is wrong with the numbers of an attribute.
pub fn fault(value: &str, field: &Field) -> Option<String> {
    if field.numbers == 0 {
        return None;
    }
    let words: Vec<&str> = value.split_whitespace().take(field.numbers + 2).collect();
    for word in &words {
        match word.parse::<f64>() {
            Err(_) => return Some(format!("{} is not a number", shown(word))),
            Ok(x) if x.is_nan() => return Some("NaN is not allowed".to_owned()),
            Ok(x) if x.is_infinite() && !field.unbounded => {
                return Some(format!("{} is not finite", shown(word)));
            }
            Ok(_) => {}
        }
    }
    (words.len() != field.numbers).then(|| match field.numbers {
        1 => "one number is expected".to_owned(),
        n => format!("{n} numbers, separated by blanks, are expected"),
    })
}
