//! Names that ROS 2 accepts, made of names of any form.

/// The package to which the types of rows belong.
const PACKAGE: &str = "condor_rows";

/// Returns the name of the field for the variable `name`, such as `index_proximal_torque` for
/// `index.proximal.torque`: lower-case letters, digits and single underscores, with a letter first. If `is_taken`
/// returns true for that name, a number is appended.
pub fn field_name(name: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let text = words(name).join("_").to_ascii_lowercase();
    let text = if text.starts_with(|first: char| first.is_ascii_lowercase()) {
        text
    } else {
        format!("v_{text}").trim_end_matches('_').to_owned()
    };
    untaken(text, "_", is_taken)
}

/// Returns the name of the message type for the rows of the loop or cell `place`, such as `condor_rows/msg/HandServo`
/// for `hand:servo`. If `is_taken` returns true for that name, a number is appended.
pub fn type_name(place: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let mut text = format!("{PACKAGE}/msg/");
    let words = words(place);
    if words
        .first()
        .is_none_or(|first| first.starts_with(|it: char| it.is_ascii_digit()))
    {
        text.push_str("Of");
    }
    for word in words {
        let (first, rest) = word.split_at(1);
        text.extend([first.to_ascii_uppercase().as_str(), rest]);
    }
    untaken(text, "N", is_taken)
}

/// Returns the name of the constant for a label of the field `field`.
pub(crate) fn constant_name(field: &str, label: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let label = words(label).join("_");
    let text = format!("{field}_{label}").to_ascii_uppercase();
    untaken(text.trim_end_matches('_').to_owned(), "_", is_taken)
}

/// The runs of ASCII letters and digits of a text.
fn words(text: &str) -> Vec<&str> {
    let words = text.split(|it: char| !it.is_ascii_alphanumeric());
    words.filter(|word| !word.is_empty()).collect()
}

fn untaken(text: String, before: &str, is_taken: impl Fn(&str) -> bool) -> String {
    if !is_taken(&text) {
        return text;
    }
    let numbered = (2_u64..).map(|number| format!("{text}{before}{number}"));
    let mut free = numbered.skip_while(|name| is_taken(name));
    free.next().unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::{constant_name, field_name, type_name};

    #[test]
    fn names_become_legal_ones() {
        let field = |name| field_name(name, |_| false);
        assert_eq!(
            field("index.proximal-flexor.effort"),
            "index_proximal_flexor_effort"
        );
        assert_eq!(field("Kp__of [x]."), "kp_of_x");
        assert_eq!(["", "µ", "3d"].map(field), ["v", "v", "v_3d"]);
        let of_type = |name| type_name(name, |_| false);
        assert_eq!(of_type("hand:servo-2"), "condor_rows/msg/HandServo2");
        assert_eq!(of_type("7:x"), "condor_rows/msg/Of7X");
        assert_eq!(
            constant_name("mode", "stand by", |_| false),
            "MODE_STAND_BY"
        );
        assert_eq!(constant_name("mode", "π", |_| false), "MODE");
    }

    #[test]
    fn taken_names_get_the_first_free_number() {
        let taken = ["a_b", "a_b_2"];
        assert_eq!(field_name("a.b", |name| taken.contains(&name)), "a_b_3");
        let taken = ["condor_rows/msg/AB"];
        assert_eq!(
            type_name("a:b", |name| taken.contains(&name)),
            "condor_rows/msg/ABN2"
        );
    }
}
