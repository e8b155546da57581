// The server runs this in each page that connects. It loads the modules and queues the calls that come meanwhile.
/** @param {string} version of the modules @param {string[]} paths of the modules @param {string} viser its version
 * @param {string[]} names of the calls */
(version, paths, viser, names) => {
  if (window.tcfit?.version === version) return;
  if (window.tcfit) {
    for (const name of names) window.tcfit[name] = () => {}; // this page is about to go
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
  // All at once: if each waited for the module that imports it, the page would do other things in between.
  for (const href of paths)
    document.head.append(Object.assign(document.createElement("link"), { rel: "modulepreload", href }));
  // Chromium resolves a relative import in evaluated code against the first document of the tab, maybe of another port.
  import(new URL("/tcfit/main.js", location.href).href).catch((error) => {
    complain(`tcfit's script could not be loaded: ${error.message}. Reload this page.`);
  });
}
