"use strict";
/* The robots of a report: each moves in step with the charts over time of its section, and shows
   the axis that is chosen there. */

function told(id) { return JSON.parse(document.getElementById(id).textContent); }

function animate(figure) {
  const {scene, camera, floor, poses, shares, marked, aside} =
    JSON.parse(figure.querySelector("script").textContent);
  const canvas = figure.querySelector("canvas"), button = figure.querySelector("button");
  const picture = new RobotPicture(canvas, {...told(scene), camera, floor});
  picture.show(poses);
  picture.shares = {0: 0, ...shares};
  picture.aside = aside;
  const place = figure.closest("section");
  const chosen = place && place.querySelector("select");
  const mark = () => { picture.marked = chosen ? [+chosen.value] : marked; };
  mark();
  if (chosen) chosen.addEventListener("change", mark);
  figure.querySelector(".still").hidden = true;
  canvas.hidden = button.hidden = false;
  const charts = place ? [...place.querySelectorAll(".chart[data-over-time] > div")] : [];
  new Motion(picture, button, time => charts.forEach(one => moveCursor(one, time)));
}

document.querySelectorAll("figure.robot").forEach(figure => {
  if (figure.querySelector("canvas")) animate(figure);
});
