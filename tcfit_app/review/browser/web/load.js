// Run by the server in each page that connects: it loads the modules, and keeps what comes for them meanwhile.
/** @param {string} version of the modules @param {string[]} paths where they are @param {string} viser its version
 * @param {string[]} names of what is called */
(version, paths, viser, names) => {
  if (window.tcfit?.version === version) return;
  if (window.tcfit) {
    for (const name of names) window.tcfit[name] = () => {}; // nothing more is for this page
    return location.reload();
  }
  /** @type {[name: string, values: any[]][]} */
  const calls = [];
  const later = Object.fromEntries(
    names.map((name) => [name, (/** @type {any[]} */ ...values) => void calls.push([name, values])]),
  );
  /** @param {string} text */
  const complain = (text) => {
    const card = document.createElement("p");
    card.setAttribute("role", "alert");
    card.textContent = text;
    card.style.cssText =
      "position: fixed; inset: 30% 20% auto; z-index: 1000; padding: 2em; margin: 0; border-radius: 12px;" +
      "background: #14171c; color: #eef2f6; border-top: 3px solid #ff5a52; font: 16px/1.5 system-ui, sans-serif";
    document.body.append(card);
    console.error(text);
  };
  window.tcfit = { version, viser, calls, complain, ...later };
  // All at once, and not each when the one before asks for it: in between the page has other things to do.
  for (const href of paths)
    document.head.append(Object.assign(document.createElement("link"), { rel: "modulepreload", href }));
  import(/** @type {any} */ ("/tcfit/main.js")).catch((error) => {
    complain(`tcfit's script could not be loaded: ${error.message}. Reload this page.`);
  });
}
