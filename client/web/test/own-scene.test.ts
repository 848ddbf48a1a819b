import { expect, test } from "vitest";
import { ownScene } from "../src/own-scene";

const SCENE = `
[[objects]]
shape = { mesh = { file = "meshes/organ.vtu", scale_m_per_unit = 0.001 } }
[[objects.regions]]
shape = { mesh = { file = "meshes/organ.vtu", scale_m_per_unit = 0.001 } }
[[tools]]
shape = { blade = { edge = { file = { file = "edge.csv", scale_m_per_unit = 1.0 } } } }
`;

const of = (...names: string[]) => ownScene(names.map((name) => ({ name })), () => Promise.resolve(SCENE));

test("the files that a scene refers to are found among those that are chosen with it, each once", async () => {
  const { toml, files } = await of("edge.csv", "mine.toml", "organ.vtu", "other.stl");
  expect(toml).toBe(SCENE);
  expect(files).toEqual([
    { name: "meshes/organ.vtu", file: { name: "organ.vtu" } },
    { name: "edge.csv", file: { name: "edge.csv" } },
  ]);
});

test("what is missing is said by its name", async () => {
  await expect(of("mine.toml", "edge.csv")).rejects.toThrow("The scene refers to organ.vtu: choose");
  await expect(of("organ.vtu")).rejects.toThrow("Choose one scene (.toml) together with its files; 0 were chosen.");
  await expect(of("a.toml", "b.toml")).rejects.toThrow("2 were chosen");
});

test("a text that cannot be read is left to the server", async () => {
  const { files } = await ownScene([{ name: "mine.toml" }], () => Promise.resolve("no [ toml"));
  expect(files).toEqual([]);
});
