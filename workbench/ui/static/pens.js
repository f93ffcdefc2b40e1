// What draws strokes: on a canvas, or into an SVG file.

export class CanvasPen {
  constructor(context) {
    this.c = context;
  }
  clip(x, y, w, hgt, draw) {
    this.c.save();
    this.c.beginPath();
    this.c.rect(x, y, w, hgt);
    this.c.clip();
    draw();
    this.c.restore();
  }
  path(steps, { stroke = null, fill = null, width = 1.5, dash = [] }) {
    const c = this.c;
    c.beginPath();
    for (const [kind, ...at] of steps) {
      if (kind === "M") c.moveTo(...at);
      else if (kind === "L") c.lineTo(...at);
      else if (kind === "O") {
        c.moveTo(at[0] + at[2], at[1]);
        c.arc(at[0], at[1], at[2], 0, 2 * Math.PI);
      } else c.closePath();
    }
    c.setLineDash(dash);
    if (fill) {
      c.fillStyle = fill;
      c.fill();
    }
    if (stroke) {
      c.strokeStyle = stroke;
      c.lineWidth = width;
      c.lineJoin = "round";
      c.stroke();
    }
  }
  text(words, x, y, { colour: ink, align = "center", size = 12, turned = false, ground = null }) {
    const c = this.c;
    c.save();
    c.fillStyle = ink;
    c.font = `${size}px system-ui, sans-serif`;
    c.textAlign = align;
    c.textBaseline = "middle";
    c.translate(x, y);
    if (turned) c.rotate(-Math.PI / 2);
    if (ground) { // legible where a curve runs through it
      [c.strokeStyle, c.lineWidth, c.lineJoin] = [ground, 4, "round"];
      c.strokeText(words, 0, 0);
    }
    c.fillText(words, 0, 0);
    c.restore();
  }
}

export class SvgPen {
  constructor(width, height) {
    this.parts = [];
    this.size = [width, height];
    this.clips = 0;
  }
  clip(x, y, w, hgt, draw) {
    const id = `c${(this.clips += 1)}`;
    this.parts.push(`<clipPath id="${id}"><rect x="${x}" y="${y}" width="${w}" height="${hgt}"/></clipPath><g clip-path="url(#${id})">`);
    draw();
    this.parts.push("</g>");
  }
  path(steps, { stroke = null, fill = null, width = 1.5, dash = [] }) {
    const d = steps.map(([kind, ...at]) => {
      if (kind === "O") {
        const [x, y, r] = at;
        return `M${x + r} ${y}A${r} ${r} 0 1 1 ${x - r} ${y}A${r} ${r} 0 1 1 ${x + r} ${y}`;
      }
      return kind === "Z" ? "Z" : `${kind}${at.map((v) => v.toFixed(2)).join(" ")}`;
    }).join("");
    const dashed = dash.length ? ` stroke-dasharray="${dash.join(" ")}"` : "";
    this.parts.push(`<path d="${d}" fill="${fill ?? "none"}" stroke="${stroke ?? "none"}" stroke-width="${width}" stroke-linejoin="round"${dashed}/>`);
  }
  text(words, x, y, { colour: ink, align = "center", size = 12, turned = false, ground = null }) {
    const anchor = { center: "middle", left: "start", right: "end" }[align];
    const safe = String(words).replace(/[<>&"]/g, (c) => `&#${c.charCodeAt(0)};`);
    const turn = turned ? ` transform="rotate(-90 ${x} ${y})"` : "";
    this.parts.push(`<text x="${x}" y="${y}" fill="${ink}" font-size="${size}" text-anchor="${anchor}" dominant-baseline="central"${turn}${ground ? ` stroke="${ground}" stroke-width="4" stroke-linejoin="round" paint-order="stroke"` : ""}>${safe}</text>`);
  }
  toString() {
    const [w, hgt] = this.size;
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${w}" height="${hgt}" viewBox="0 0 ${w} ${hgt}" font-family="sans-serif">${this.parts.join("")}</svg>`;
  }
}
