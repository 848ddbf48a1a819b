// Dialogs: over the page, closed by Escape, by their button or by a click beside them.

import { element, iconButton } from "./dom";

export function openDialog(title: string, ...content: HTMLElement[]): HTMLDialogElement {
  const close = iconButton("putAway", "Close", "Esc", () => dialog.close());
  const head = element("header", { className: "row" }, element("h1", { textContent: title }), close);
  const dialog = element("dialog", { className: "panel", aria: { label: title } }, head, ...content);
  dialog.addEventListener("close", () => dialog.remove());
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) dialog.close();
  });
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}
