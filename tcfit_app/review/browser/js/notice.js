// What the app says over the picture: a card, lines at the lower edge, a colour bar.

const LOST = {
  title: "tcfit has ended or cannot be reached",
  text:
    "All that was said to be saved is on the disk.\nThis page goes on by itself once it is connected again. " +
    "If tcfit has ended, start it again (tcfit review ...) and open the link that it prints.",
  kind: "error",
  progress: null,
};
const SILENT = {
  title: "tcfit does not answer",
  text:
    "All that was said to be saved is on the disk.\nEither tcfit is held up, or the connection to it hangs. " +
    "This page goes on by itself once it answers; until then it takes nothing. Reloading it may help.",
  kind: "error",
  progress: null,
};

function drawCard() {
  const notice = states.lost ? (states.lost === "silent" ? SILENT : LOST) : states.notice;
  card.hidden = !notice;
  if (!notice) return;
  card.style.setProperty("--kind", KIND_COLORS[notice.kind]);
  card.setAttribute("role", notice.kind === "error" ? "alert" : "status");
  const parts = [element("h2", "", null, notice.title)];
  if (notice.text) parts.push(element("p", "", null, notice.text));
  if (notice.kind === "loading" || notice.progress !== null) parts.push(progressTrack(notice.progress));
  card.replaceChildren(...parts);
}

watch("notice", drawCard);
watch("lost", (lost) => {
  layer.classList.toggle("tcfit-lost", Boolean(lost));
  drawCard();
});

function progressTrack(progress) {
  const track = element("div", "tcfit-track");
  const bar = element("div", progress === null ? "tcfit-bar tcfit-waiting" : "tcfit-bar", track);
  if (progress !== null) bar.style.width = `${100 * progress}%`;
  return track;
}

watch("chips", (state) => chipsBox.replaceChildren(...(state?.chips ?? []).map(chip)));

function chip({ text, kind, progress }) {
  const made = element("div", "tcfit-chip");
  made.style.setProperty("--kind", KIND_COLORS[kind]);
  element("div", "tcfit-dot", made).style.background = KIND_COLORS[kind];
  element("span", "", made, text);
  if (progress !== null) element("div", "tcfit-bar", made).style.width = `${100 * progress}%`;
  return made;
}

watch("legend", (legend) => {
  legendBox.hidden = !legend;
  if (!legend) return;
  const colors = element("div", "");
  colors.style.background = `linear-gradient(to right, ${legend.colors.join(", ")})`;
  const [low, high] = [legend.low, legend.high].map((value) => String(Number(value.toPrecision(3))));
  const title = legend.unit ? `${legend.title} [${legend.unit}]` : legend.title;
  const [name, first, last] = [title, low, high].map((text) => element("span", "", null, text));
  legendBox.replaceChildren(name, first, colors, last);
});
