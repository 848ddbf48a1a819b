// Which scene, or which session: the first thing that is asked.

import { SessionState } from "../gen/kerf/v1/types_pb";
import { inWords } from "../net/errors";
import { sessions } from "../net/server";
import { openDialog } from "./dialog";
import { element, textButton } from "./dom";
import { say } from "./messages";

/** What was chosen. */
export interface StartChoice {
  scene(name: string): void;
  session(id: string): void;
}

const STATES: Partial<Record<SessionState, string>> = {
  [SessionState.RUNNING]: "running",
  [SessionState.PAUSED]: "paused",
  [SessionState.FAILED]: "failed",
};

export async function openStart(choice: StartChoice): Promise<void> {
  const scenes = element("div", { className: "cards" });
  const running = element("div", { className: "sessions" });
  const dialog = openDialog("Choose what to cut", running, scenes);
  dialog.classList.add("start");
  const choose = (act: () => void) => () => {
    dialog.close();
    act();
  };
  try {
    await listSessions(running, choice, choose);
    const { scenes: known } = await sessions.listScenes({});
    for (const { name, description } of known) {
      const card = element(
        "button",
        { type: "button", className: "card", data: { scene: name } },
        picture(name),
        element("strong", { textContent: title(name) }),
        element("span", { textContent: description }),
      );
      card.addEventListener("click", choose(() => choice.scene(name)));
      scenes.append(card);
    }
    scenes.querySelector("button")?.focus();
  } catch (error) {
    scenes.replaceChildren(
      element("p", { textContent: inWords(error) }),
      textButton("Try again", choose(() => void openStart(choice)), "primary"),
    );
  }
}

async function listSessions(
  into: HTMLElement,
  choice: StartChoice,
  choose: (act: () => void) => () => void,
): Promise<void> {
  const { sessions: running } = await sessions.listSessions({});
  if (running.length === 0) return into.replaceChildren();
  const rows = running.map(({ sessionId, sceneName, state }) => {
    const end = async () => {
      try {
        await sessions.closeSession({ sessionId });
        await listSessions(into, choice, choose);
      } catch (error) {
        say(inWords(error), "problem");
      }
    };
    return element(
      "div",
      { className: "row" },
      element("span", { textContent: `${title(sceneName)} · ${STATES[state] ?? "ending"}` }),
      textButton("Join", choose(() => choice.session(sessionId)), "primary"),
      textButton("End", () => void end()),
    );
  });
  into.replaceChildren(element("h2", { textContent: "Sessions that are there" }), ...rows);
}

/** What a built-in scene looks like; nothing of one that has no picture. */
function picture(name: string): HTMLImageElement {
  const image = element("img", { src: `scene-${name}.jpg`, alt: "", width: 320, height: 180 });
  image.addEventListener("error", () => image.remove());
  return image;
}

/** `gummy-bear` as `Gummy bear`. */
export function title(name: string): string {
  const words = name.replaceAll("-", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}
