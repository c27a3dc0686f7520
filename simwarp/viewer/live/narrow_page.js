// Of a narrow page, such as a phone's: the panels are a sheet below, as wide as the page and at first only its handle.
// Runs as the body of a function, once per page.
const NARROW = "(max-width: 36em)"; // where viser shows its sheet
const PATIENCE = 10000; // until the sheet is there [ms]

const sheet = () => [...document.querySelectorAll("div")].find((each) =>
  each.style.position === "fixed" && each.style.bottom === "0px" && each.style.zIndex === "10");

if (!window.simwarpNarrow && matchMedia(NARROW).matches) {
  window.simwarpNarrow = true;
  const began = performance.now();
  const fold = () => {
    const found = sheet();
    const handle = found && [...found.querySelectorAll("div")].find((each) => each.style.cursor === "pointer");
    if (!handle) {
      if (performance.now() - began < PATIENCE) setTimeout(fold, 50);
      return;
    }
    found.style.width = found.firstElementChild.style.width = "100%";
    found.style.maxHeight = "50%";
    for (const each of found.querySelectorAll("div")) if (each.style.width === "20em") each.style.width = "100%";
    handle.click();
  };
  fold();
}
