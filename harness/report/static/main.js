// Everything that the page holds is set up once.

/** Copies a program; where the browser refuses, selects it, so that the user's own copy command takes it. */
function copying(program) {
  const [button, code] = [program.querySelector("button"), program.querySelector("code")];
  button.hidden = false;
  button.setAttribute("aria-live", "polite");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(code);
      button.textContent = "Selected";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
}

document.querySelectorAll("table").forEach(named);
document.querySelectorAll("table.sortable").forEach(sortable);
document.querySelectorAll("figure.chart").forEach(chart);
document.querySelectorAll("figure.comparison").forEach(comparison);
document.querySelectorAll("div.player").forEach(player);
document.querySelectorAll("div.program").forEach(copying);
