"use strict";
/* The motion of a robot in a picture, again and again, and the line that shows its time in a chart. */

class Motion {
  /* also: called with the time [s] of each picture */
  constructor(picture, button, also) {
    Object.assign(this, {picture, button, also, time: 0, before: null, drawn: 0});
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.say();
    button.addEventListener("click", () => { this.playing = !this.playing; this.say(); });
    const step = now => { this.step(now); requestAnimationFrame(step); };
    requestAnimationFrame(step);
  }

  say() { this.button.textContent = this.playing ? "Pause" : "Play"; }

  step(now) {
    if (this.playing && this.before !== null && !document.hidden)
      this.time = (this.time + Math.min(now - this.before, 200) / 1000)
        % this.picture.poses.duration;
    if (now - this.drawn > 33) {
      this.picture.draw(this.time);
      this.also(this.time);
      this.drawn = now;
    }
    this.before = now;
  }
}

/* Puts the line that shows the time into a chart of plotly.js over time. */
function moveCursor(box, time) {
  let line = box.querySelector(".cursor");
  if (!line) {
    line = document.createElement("div");
    line.className = "cursor";
    box.append(line);
  }
  const layout = box._fullLayout;
  if (!layout || !layout.xaxis) return;
  const x = layout.xaxis._offset + layout.xaxis.l2p(time);
  const inside = x >= layout.xaxis._offset && x <= layout.xaxis._offset + layout.xaxis._length;
  line.style.display = inside ? "block" : "none";
  line.style.left = x + "px";
  line.style.top = layout._size.t + "px";
  line.style.height = layout._size.h + "px";
}
