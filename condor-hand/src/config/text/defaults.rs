//! The sources of the values that a joint, an actuator or a finger leaves out.

use core::ops::Range;
use std::vec::Vec;

use condor_toml::{Misreading, Spanned};
use toml::de::{DeTable, DeValue};

type Value<'t> = Spanned<DeValue<'t>>;

/// The lists of a finger, each with the key of the defaults of its entries, in a finger or for all fingers.
const LISTS: [(&str, &str); 3] = [
    ("joints", "joint_defaults"),
    ("followers", "follower_defaults"),
    ("actuators", "actuator_defaults"),
];

type Defaults<'t> = [Option<Value<'t>>; LISTS.len()];

/// The finger from which another takes what it leaves out.
const LIKE: &str = "like";

/// The key that a finger does not take from the finger that it is like.
const CHANNEL: &str = "channel";

/// Keys whose tables have one key that chooses: two choices do not mix.
const CHOICES: [&str; 4] = ["form", "motion", "rotation", "shape"];

/// A table that is not completed: an actuator moves these joints and no others.
const WHOLE: &str = "arms";

/// Fills in what the fingers, joints and actuators leave out, and removes the keys that say from where.
pub(super) fn fill(tree: &mut Value<'_>) -> Result<(), Misreading> {
    let general = take_defaults(tree)?;
    let Some(DeValue::Array(fingers)) = get_mut(tree, "fingers") else {
        return Ok(());
    };
    let mut above: Vec<Value<'_>> = Vec::new();
    for finger in fingers.iter_mut() {
        let own = take_defaults(finger)?;
        let like = match take(finger, LIKE) {
            Some(like) => Some(find(&above, &like)?),
            None => None,
        };
        add_defaults(finger, &own);
        if let Some(like) = like {
            add_finger(finger, like);
            // Entries that only the other finger has come with the other finger's defaults.
            add_defaults(finger, &own);
        }
        add_defaults(finger, &general);
        let mut model = finger.clone();
        disconnect(&mut model);
        above.push(model);
    }
    Ok(())
}

fn get_mut<'a, 't>(table: &'a mut Value<'t>, key: &str) -> Option<&'a mut DeValue<'t>> {
    match table.get_mut() {
        DeValue::Table(entries) => entries.get_mut(key).map(Spanned::get_mut),
        _ => None,
    }
}

/// Takes an entry out of a table.
fn take<'t>(table: &mut Value<'t>, key: &str) -> Option<Value<'t>> {
    match table.get_mut() {
        DeValue::Table(entries) => entries.remove(key),
        _ => None,
    }
}

/// Takes the defaults of the lists out of a table.
fn take_defaults<'t>(table: &mut Value<'t>) -> Result<Defaults<'t>, Misreading> {
    let mut all = [None, None, None];
    for (place, (_, key)) in all.iter_mut().zip(LISTS) {
        *place = take(table, key);
        if let Some(value) = place
            && !value.get_ref().is_table()
        {
            return Err(Misreading::unsuitable(value, "a table of defaults"));
        }
    }
    Ok(all)
}

/// The finger above that `like` names.
fn find<'a, 't>(above: &'a [Value<'t>], like: &Value<'_>) -> Result<&'a Value<'t>, Misreading> {
    let Some(name) = like.get_ref().as_str() else {
        return Err(Misreading::unsuitable(like, "the name of a finger"));
    };
    let is_meant = |finger: &&Value<'_>| name_of(finger) == Some(name);
    above.iter().find(is_meant).ok_or_else(|| {
        let problem = std::format!("no finger `{name}` stands above this one");
        Misreading::at(&like.span(), problem)
    })
}

fn entries<'a, 't>(
    finger: &'a mut Value<'t>,
    list: &str,
) -> impl Iterator<Item = &'a mut Value<'t>> {
    let entries = match get_mut(finger, list) {
        Some(DeValue::Array(entries)) => Some(entries.iter_mut()),
        _ => None,
    };
    entries.into_iter().flatten()
}

fn add_defaults<'t>(finger: &mut Value<'t>, defaults: &Defaults<'t>) {
    for ((list, _), defaults) in LISTS.into_iter().zip(defaults) {
        if let Some(defaults) = defaults {
            entries(finger, list).for_each(|entry| add(entry, defaults));
        }
    }
}

/// Adds what a finger leaves out, to each entry of a list from the one of the same name, or from the one in the same
/// place if there is none.
fn add_finger<'t>(finger: &mut Value<'t>, like: &Value<'t>) {
    let is_named = finger.get_ref().get("name").is_some();
    add(finger, like);
    if !is_named {
        take(finger, "name");
    }
    for (list, _) in LISTS {
        let others = like.get_ref().get(list);
        if let Some(others) = others.and_then(|others| others.get_ref().as_array()) {
            for (place, entry) in entries(finger, list).enumerate() {
                let name = name_of(entry);
                let same = others
                    .iter()
                    .find(|other| name.is_some() && name_of(other) == name);
                if let Some(other) = same.or_else(|| others.get(place)) {
                    add(entry, other);
                }
            }
        }
    }
}

/// The name of a table; `None` if it has none.
fn name_of<'a>(table: &'a Value<'_>) -> Option<&'a str> {
    table.get_ref().get("name")?.get_ref().as_str()
}

/// Adds what a table leaves out, at any depth; other values, and lists, stay as they are.
fn add<'t>(value: &mut Value<'t>, defaults: &Value<'t>) {
    let span = value.span();
    let (DeValue::Table(own), DeValue::Table(defaults)) = (value.get_mut(), defaults.get_ref())
    else {
        return;
    };
    for (key, default) in defaults {
        match own.get_mut(key) {
            Some(_) if key.get_ref() == WHOLE => {}
            Some(value) if !is_choice(key.get_ref()) || is_same_choice(value, default) => {
                add(value, default);
            }
            Some(_) => {}
            None => {
                own.insert(key.clone(), fill_in(key.get_ref(), default, &span));
            }
        }
    }
}

fn is_choice(key: &str) -> bool {
    CHOICES.contains(&key)
}

fn is_same_choice(value: &Value<'_>, default: &Value<'_>) -> bool {
    match (value.get_ref(), default.get_ref()) {
        (DeValue::Table(own), DeValue::Table(others)) => {
            own.keys().all(|key| others.contains_key(key))
        }
        _ => false,
    }
}

/// A default that stands in the table at `span` from now on: what it lacks is lacking there. A choice is whole.
fn fill_in<'t>(key: &str, default: &Value<'t>, span: &Range<usize>) -> Value<'t> {
    match default.get_ref() {
        DeValue::Table(entries) if !is_choice(key) => {
            let entries = entries.iter();
            let entries = entries.map(|(key, value)| {
                let filled = fill_in(key.get_ref(), value, span);
                (key.clone(), filled)
            });
            let entries: DeTable<'_> = entries.collect();
            Spanned::new(span.clone(), DeValue::Table(entries))
        }
        _ => default.clone(),
    }
}

/// Removes every `channel`: no two sensors or actuators share one.
fn disconnect(value: &mut Value<'_>) {
    match value.get_mut() {
        DeValue::Table(entries) => {
            entries.remove(CHANNEL);
            entries.iter_mut().for_each(|(_, value)| disconnect(value));
        }
        DeValue::Array(list) => list.iter_mut().for_each(disconnect),
        _ => {}
    }
}
