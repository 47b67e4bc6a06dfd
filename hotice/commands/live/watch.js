// The panel of a run that is trained: its curves and families, and the page anew when another checkpoint has walked.
"use strict";
(() => {
  if (!window.hotice) return; // no WebGL: the viewer has said so
  const watch = window.hotice.page.steer;
  const $ = (id) => document.getElementById(id);
  const COLORS = { reward: "#1d55b0", success: "#15803d" };
  const SILENT_S = 5;
  $("info").append($("training"));
  $("watched").textContent = watch.watches;
  let newest = null;
  let heard = 0;
  let leaving = false;

  function draw(curves) {
    const canvas = $("growth");
    const ratio = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth || 300, canvas.clientHeight || 72];
    [canvas.width, canvas.height] = [width * ratio, height * ratio];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const { steps } = curves;
    const reward = curves.reward.filter((v) => v !== null);
    // rewards between their least and most, shares of arrivals from 0 to 1
    const ranges = { reward: [Math.min(...reward), Math.max(...reward)], success: [0, 1] };
    const x = (s) => 1 + (width - 2) * (steps.at(-1) > steps[0] ? (s - steps[0]) / (steps.at(-1) - steps[0]) : 0);
    for (const [name, color] of Object.entries(COLORS)) {
      const [low, high] = ranges[name];
      const y = (v) => height - 2 - (height - 4) * (high > low ? (v - low) / (high - low) : 0.5);
      pen.strokeStyle = color;
      pen.lineWidth = 1.6;
      pen.beginPath();
      let down = false;
      curves[name].forEach((v, i) => {
        if (v === null) return;
        if (down) pen.lineTo(x(steps[i]), y(v)); else pen.moveTo(x(steps[i]), y(v));
        down = true;
      });
      pen.stroke();
    }
  }
  function bold(name, text) {
    const part = document.createElement("b");
    part.className = name;
    part.textContent = text;
    return part;
  }
  const lastOf = (values) => values.findLast((v) => v !== null);
  function tell(curves) {
    const [reward, success] = [lastOf(curves.reward), lastOf(curves.success)];
    const known = curves.reward.filter((v) => v !== null);
    const parts = [];
    if (reward !== undefined) parts.push(bold("reward", `reward ${reward.toFixed(3)}`),
      ` from ${Math.min(...known).toFixed(3)} to ${Math.max(...known).toFixed(3)}`);
    if (success !== undefined) parts.push(parts.length ? ", " : "", bold("success", `arrivals ${(100 * success).toFixed(0)} %`));
    $("grown").replaceChildren(...parts);
  }
  function list(families) {
    $("families").replaceChildren(...families.map(([name, share]) => {
      const [line, words, bar, number] = ["li", "span", "meter", "span"].map((kind) => document.createElement(kind));
      words.textContent = name.replaceAll("_", " ");
      bar.value = share;
      bar.setAttribute("aria-label", `Arrivals in ${words.textContent}`);
      number.textContent = `${(100 * share).toFixed(0)} %`;
      line.append(words, bar, number);
      return line;
    }));
  }
  function show() {
    const { last, age } = newest;
    if (last.update !== null && last.update !== undefined) {
      const ago = age === null ? "" : `, ${Math.round(age + (performance.now() - heard) / 1000)} s ago`;
      $("counters").textContent = `update ${last.update}, ${(last.steps / 1e6).toFixed(2)} M steps, `
        + `${last.minutes.toFixed(1)} min, ${Math.round(last.steps_per_s)} steps/s${ago}`;
    }
    if (newest.curves.steps.length) { draw(newest.curves); tell(newest.curves); }
    list(newest.families);
    const other = newest.version > watch.version;
    $("told").textContent = other && !$("newest").checked ? "a newer checkpoint has walked" : newest.said;
    if (other && $("newest").checked && !leaving) {
      leaving = true;
      window.history.replaceState(null, "", `#rollout=${Number($("rollout").value) + 1}`);
      window.location.reload();
    }
  }
  const source = new EventSource(watch.events);
  source.addEventListener("message", (message) => {
    heard = performance.now();
    newest = JSON.parse(message.data);
    show();
  });
  source.addEventListener("over", () => { source.close(); $("told").textContent = "no longer watched"; });
  $("newest").addEventListener("change", () => newest && show());
  setInterval(() => {
    if (!newest || source.readyState === EventSource.CLOSED) return;
    if (performance.now() - heard > 1000 * SILENT_S) $("told").textContent = "no news: was it ended?";
    else show();
  }, 1000);
})();
