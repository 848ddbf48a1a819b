import { parse, type TomlTable } from "smol-toml";
import { expect, test } from "vitest";
import { SceneText } from "../src/scene-text";

const TOML = `
version = 1
name = "block"
rate_hz = 500.0

[[objects]]
name = "block"
shape = { box = { min_m = [-0.01, -0.01, -0.01], max_m = [0.01, 0.01, 0.01] } }
level = 1
material = { young_modulus_pa = 3.0e4, poisson_ratio = 0.4 }

[[tools]]
name = "knife"
shape = { blade = { width_m = 0.02, height_m = 0.01 } }

[[tools]]
name = "forceps"
shape = { grasper = { radius_m = 0.01 } }
`;

test("what can be changed has a place, a value and limits", () => {
  const { groups } = new SceneText(TOML);
  expect(groups.map(({ title }) => title)).toEqual(["Time", "block", "knife"]);
  const [time, block] = groups;
  expect([time.settings[0].value, block.settings[0].value, block.settings[3].value]).toEqual([500, 3e4, 1]);
});

test("a scene has a tool of every kind, and keeps its own", () => {
  const scene = new SceneText(TOML);
  scene.addMissingTools();
  const tools = parse(scene.toString())["tools"] as TomlTable[];
  expect(tools.map(({ name }) => name)).toEqual(["knife", "forceps", "scissors", "probe"]);
  expect(tools[2]["shape"]).toEqual({ scissors: { blade_length_m: 0.012, blade_height_m: 0.002 } });
  const text = scene.toString();
  scene.addMissingTools();
  expect(scene.toString()).toBe(text);
});

test("what is changed is in the text, and what is not stays as it was", () => {
  const scene = new SceneText(TOML);
  const [, block, knife] = scene.groups;
  block.settings[0].set(5e4);
  block.settings[1].set(0);
  knife.settings[0].set(0.03);
  const again = new SceneText(scene.toString());
  const values = again.groups.map(({ settings }) => settings.map(({ value }) => value));
  expect(values).toEqual([[500], [5e4, 0, 0, 1], [0.03, 0.01, 0, 0]]);
  expect(scene.toString()).not.toContain("fracture_energy");
  expect(scene.toString()).toContain("grasper");
});
