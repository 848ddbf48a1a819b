// Draws blocks of ```math as formulas, by KaTeX where `make docs` found it; else the source stays readable.
(() => {
  const blocks = document.querySelectorAll("code.language-math");
  if (!blocks.length) return;
  const katex = (file) => new URL(`katex/${file}`, new URL(path_to_root || "./", document.location.href)).href;
  const style = Object.assign(document.createElement("link"), { rel: "stylesheet", href: katex("katex.min.css") });
  const script = Object.assign(document.createElement("script"), { src: katex("katex.min.js") });
  script.onload = () => {
    for (const block of blocks) {
      const formula = document.createElement("div");
      window.katex.render(block.textContent, formula, { displayMode: true, throwOnError: false });
      block.closest("pre").replaceWith(formula);
    }
  };
  document.head.append(style, script);
})();
