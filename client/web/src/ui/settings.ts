// Changes a scene's numbers. A scene is built once, so a change begins a session anew with it.

import { inWords } from "../net/errors";
import { sessions } from "../net/server";
import { SceneText, type Setting } from "../scene-text";
import { openDialog } from "./dialog";
import { element, textButton } from "./dom";

/** `begin` starts a session of the text, or throws why it cannot. */
export async function openSettings(sessionId: string, begin: (toml: string) => Promise<void>): Promise<void> {
  const form = element("form", { className: "settings", noValidate: true });
  const problem = element("p", { className: "problem", aria: { role: "alert" } });
  const dialog = openDialog("Change the scene", form);
  let scene: SceneText;
  try {
    scene = new SceneText((await sessions.getScene({ of: { case: "sessionId", value: sessionId } })).sceneToml);
  } catch (error) {
    form.append(element("p", { className: "problem", textContent: inWords(error) }));
    return;
  }
  const text = element("textarea", { spellcheck: false, value: scene.toString(), aria: { label: "Scene file" } });
  // A number that is changed shows in the text, which is what is sent.
  const groups = scene.groups.map(({ title, settings }) =>
    element(
      "fieldset",
      {},
      element("legend", { textContent: title }),
      ...settings.map((setting) => field(setting, () => (text.value = scene.toString()))),
    ),
  );
  const apply = async () => {
    problem.textContent = "";
    form.classList.add("busy");
    try {
      await begin(text.value);
      dialog.close();
    } catch (error) {
      problem.textContent = inWords(error);
      problem.scrollIntoView();
    }
    form.classList.remove("busy");
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void apply();
  });
  const start = textButton("Begin with these", () => void apply(), "primary");
  form.append(
    element("p", { textContent: "The tissue is made anew; what was cut is whole again." }),
    ...groups,
    element("details", {}, element("summary", { textContent: "The whole scene as text" }), text),
    problem,
    element("div", { className: "row" }, start),
  );
  form.querySelector("input")?.focus();
}

function field({ label, unit, least, most, value, set }: Setting, changed: () => void): HTMLElement {
  const input = element("input", { type: "number", value: String(value), min: String(least), max: String(most) });
  input.step = "any";
  input.addEventListener("input", () => {
    if (Number.isNaN(input.valueAsNumber)) return;
    set(input.valueAsNumber);
    changed();
  });
  return element("label", {}, element("span", { textContent: label }), input, element("span", { textContent: unit }));
}
