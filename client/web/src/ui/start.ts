// Which scene, or which session: the first thing that is asked.

import { ConnectError } from "@connectrpc/connect";
import { SessionState } from "../gen/kerf/v1/types_pb";
import { inWords } from "../net/errors";
import { sendFiles } from "../net/send-files";
import { sessions } from "../net/server";
import { heldToken } from "../net/token";
import { ENDINGS, ownScene } from "../own-scene";
import { openDialog } from "./dialog";
import { element, textButton } from "./dom";
import { say } from "./messages";

/** What was chosen. */
export interface StartChoice {
  /** Private: its owner, operators and those who are handed a link see it. */
  scene(name: string, isPrivate: boolean): void;
  session(id: string): void;
  /** A scene of one's own, whose files the server has by the name of their upload. */
  own(sceneToml: string, uploadId: string, isPrivate: boolean): void;
}

const STATES: Partial<Record<SessionState, string>> = {
  [SessionState.RUNNING]: "running",
  [SessionState.PAUSED]: "paused",
  [SessionState.FAILED]: "failed",
};

export async function openStart(choice: StartChoice): Promise<void> {
  const scenes = element("div", { className: "cards" });
  const running = element("div", { className: "sessions" });
  const own = element("div", { className: "row own" });
  const privacy = element("input", { type: "checkbox", name: "private" });
  // A server that asks for no token cannot tell an owner from others.
  const begin = element(
    "label",
    { className: "check", hidden: heldToken() === undefined },
    privacy,
    element("span", { textContent: "Begin it in private: you, operators and those you hand a link see the session" }),
  );
  const dialog = openDialog("Choose what to cut", running, begin, scenes, own);
  dialog.classList.add("start");
  const choose = (act: () => void) => () => {
    dialog.close();
    act();
  };
  offerOwn(own, (toml, uploadId) => choose(() => choice.own(toml, uploadId, privacy.checked))());
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
      card.addEventListener("click", choose(() => choice.scene(name, privacy.checked)));
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

/** A scene from files of whoever sits at the page. */
function offerOwn(into: HTMLElement, begin: (toml: string, uploadId: string) => void): void {
  const files = element("input", { type: "file", multiple: true, accept: ENDINGS, hidden: true, aria: { label: "Files of a scene" } });
  const said = element("span", { aria: { live: "polite" } });
  const bar = element("progress", { hidden: true, max: 1, aria: { label: "Files sent" } });
  const choose = textButton("A scene of your own…", () => files.click());
  files.addEventListener("change", () => void send([...(files.files ?? [])]));
  const send = async (chosen: File[]) => {
    // The same files may be chosen again.
    files.value = "";
    if (chosen.length === 0) return;
    choose.disabled = true;
    said.textContent = "";
    try {
      const { toml, files: named } = await ownScene(chosen, (file) => file.text());
      bar.value = 0;
      bar.hidden = false;
      const uploadId = await sendFiles(named, (sentBytes, totalBytes) => {
        bar.value = totalBytes === 0 ? 1 : sentBytes / totalBytes;
        said.textContent = `${megabytes(sentBytes)} of ${megabytes(totalBytes)} MB sent`;
      });
      if (into.isConnected) begin(toml, uploadId);
    } catch (error) {
      said.textContent = error instanceof ConnectError ? inWords(error) : (error as Error).message;
    }
    bar.hidden = true;
    choose.disabled = false;
  };
  into.replaceChildren(choose, files, bar, said);
}

function megabytes(bytes: number): string {
  return (bytes / 1e6).toFixed(1);
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
