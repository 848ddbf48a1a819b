// Points of a session that one can go back to.

import { inWords } from "../net/errors";
import { sessions } from "../net/server";
import { openDialog } from "./dialog";
import { element, textButton } from "./dom";
import { say } from "./messages";

/** Saves the state as it is under the next free number. */
export async function savePoint(sessionId: string): Promise<void> {
  const { checkpoints } = await sessions.listCheckpoints({ sessionId });
  const names = new Set(checkpoints.map(({ name }) => name));
  let number = checkpoints.length + 1;
  while (names.has(`Point ${number}`)) number += 1;
  await sessions.saveCheckpoint({ sessionId, name: `Point ${number}` });
}

export async function openPoints(sessionId: string): Promise<void> {
  const list = element("div", { className: "sessions" });
  const dialog = openDialog("Go back to a point", list);
  const attempt = async (act: () => Promise<unknown>) => {
    try {
      await act();
    } catch (error) {
      say(inWords(error), "problem");
    }
  };
  const show = async () => {
    const { checkpoints } = await sessions.listCheckpoints({ sessionId });
    const rows = checkpoints.map(({ name, simTimeS }) => {
      const restore = () => sessions.restoreCheckpoint({ sessionId, name });
      const forget = () => sessions.deleteCheckpoint({ sessionId, name });
      return element(
        "div",
        { className: "row" },
        element("span", { textContent: `${name} · at ${simTimeS.toFixed(1)} s` }),
        textButton("Go back", () => void attempt(restore).then(() => dialog.close()), "primary"),
        textButton("Forget", () => void attempt(forget).then(show)),
      );
    });
    const none = element("p", { textContent: "No point was saved yet. Save one before a cut, to undo it." });
    list.replaceChildren(...(rows.length > 0 ? rows : [none]));
  };
  await attempt(show);
}
