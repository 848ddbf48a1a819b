//! Names and texts of the built-in scenes.

/// Name and TOML of each.
pub(crate) const BUILTIN: [(&str, &str); 17] = [
    ("jelly", include_str!("../builtin/jelly.toml")),
    ("tofu", include_str!("../builtin/tofu.toml")),
    ("rubber", include_str!("../builtin/rubber.toml")),
    ("cuboid", include_str!("../builtin/cuboid.toml")),
    ("cuboid-polyline", include_str!("../builtin/cuboid-polyline.toml")),
    ("cuboid-sine", include_str!("../builtin/cuboid-sine.toml")),
    ("gummy-bear", include_str!("../builtin/gummy-bear.toml")),
    ("liver", include_str!("../builtin/liver.toml")),
    ("liver-tissue", include_str!("../builtin/liver-tissue.toml")),
    ("hepatectomy", include_str!("../builtin/hepatectomy.toml")),
    ("two-organs", include_str!("../builtin/two-organs.toml")),
    ("skin", include_str!("../builtin/skin.toml")),
    ("gelatine", include_str!("../builtin/gelatine.toml")),
    ("potato", include_str!("../builtin/potato.toml")),
    ("cucumber", include_str!("../builtin/cucumber.toml")),
    ("apple", include_str!("../builtin/apple.toml")),
    ("pressed-block", include_str!("../builtin/pressed-block.toml")),
];

/// Names of the built-in scenes.
#[must_use]
pub fn builtin_names() -> [&'static str; BUILTIN.len()] {
    BUILTIN.map(|(name, _)| name)
}
