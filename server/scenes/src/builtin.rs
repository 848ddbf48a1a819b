//! Names and texts of the built-in scenes.

/// Name and TOML of each, in the order in which a newcomer would look at them.
pub(crate) const BUILTIN: [(&str, &str); 18] = [
    ("liver-tissue", include_str!("../builtin/liver-tissue.toml")),
    ("liver", include_str!("../builtin/liver.toml")),
    ("gummy-bear", include_str!("../builtin/gummy-bear.toml")),
    ("apple", include_str!("../builtin/apple.toml")),
    ("tofu", include_str!("../builtin/tofu.toml")),
    ("jelly", include_str!("../builtin/jelly.toml")),
    ("tense-skin", include_str!("../builtin/tense-skin.toml")),
    ("hepatectomy", include_str!("../builtin/hepatectomy.toml")),
    ("two-organs", include_str!("../builtin/two-organs.toml")),
    ("potato", include_str!("../builtin/potato.toml")),
    ("cucumber", include_str!("../builtin/cucumber.toml")),
    ("skin", include_str!("../builtin/skin.toml")),
    ("gelatine", include_str!("../builtin/gelatine.toml")),
    ("rubber", include_str!("../builtin/rubber.toml")),
    ("cuboid", include_str!("../builtin/cuboid.toml")),
    ("cuboid-sine", include_str!("../builtin/cuboid-sine.toml")),
    ("cuboid-polyline", include_str!("../builtin/cuboid-polyline.toml")),
    ("pressed-block", include_str!("../builtin/pressed-block.toml")),
];

/// Names of the built-in scenes.
#[must_use]
pub fn builtin_names() -> [&'static str; BUILTIN.len()] {
    BUILTIN.map(|(name, _)| name)
}
