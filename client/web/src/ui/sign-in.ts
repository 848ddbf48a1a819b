// Asks for a token, when the server does.

import { isToken, keepToken } from "../net/token";
import { openDialog } from "./dialog";
import { element } from "./dom";

let isOpen = false;

export function openSignIn(): void {
  if (isOpen) return;
  isOpen = true;
  const input = element("input", { type: "password", name: "token", autocomplete: "off", required: true, aria: { label: "Token" } });
  const form = element(
    "form",
    { className: "row" },
    input,
    element("button", { type: "submit", className: "primary", textContent: "Sign in" }),
  );
  const text = "This server lets nobody in without a token. Whoever runs it makes one for you: kerf-server token new.";
  const dialog = openDialog("Sign in", element("p", { textContent: text }), form);
  dialog.addEventListener("close", () => (isOpen = false));
  input.addEventListener("input", () => input.setCustomValidity(""));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const token = input.value.trim();
    if (isToken(token)) {
      keepToken(token);
      // What was refused so far is asked anew.
      location.reload();
      return;
    }
    input.setCustomValidity("This cannot be a token: it has letters, digits, - and _ alone.");
    input.reportValidity();
  });
  input.focus();
}
