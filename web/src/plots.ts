// Scrolling plots of the last ten seconds.

import uPlot from 'uplot';

export interface Curve {
  label: string;
  colour: string;
  value(sample: Float64Array): number | null; // null: not known
}
export interface PlotSpec {
  title: string;
  unit: string;
  curves: Curve[];
}

const SPAN_S = 10;
const HEIGHT = 112; // pixels
const SPACE = 18; // pixels from tick to tick at least: increments double at most, so that two of them have room
const POINTS = 1300; // of SPAN_S at the plots' rate

/** A curve that is constant lies in the middle. */
function yRange(_u: uPlot, min: number | null, max: number | null): [number, number] {
  if (min === null || max === null) return [-1, 1];
  if (max - min > 1e-9 * Math.max(1, Math.abs(max))) return uPlot.rangeNum(min, max, 0.1, true) as [number, number];
  return [min - 1, max + 1];
}

export class Plots {
  private readonly t: number[] = [];
  private readonly columns: (number | null)[][][];
  private readonly plots: uPlot[];
  paused = false;

  constructor(
    parent: HTMLElement,
    private readonly specs: PlotSpec[],
  ) {
    this.columns = specs.map((s) => s.curves.map(() => []));
    const css = getComputedStyle(document.documentElement);
    const colour = (name: string): string => css.getPropertyValue(name).trim();
    parent.replaceChildren();
    this.plots = specs.map((spec) => {
      const box = document.createElement('figure');
      const caption = document.createElement('figcaption'), title = document.createElement('b');
      title.textContent = `${spec.title} [${spec.unit}]`;
      caption.append(title);
      if (spec.curves.length > 1)
        for (const c of spec.curves) {
          const name = document.createElement('i');
          name.textContent = c.label;
          name.style.color = colour(c.colour);
          caption.append(name);
        }
      box.append(caption);
      parent.append(box);
      const axis = { stroke: colour('--text'), grid: { stroke: colour('--grid'), width: 1 }, ticks: { show: false }, font: '11px system-ui' };
      const plot = new uPlot(
        {
          width: 200,
          height: HEIGHT,
          pxAlign: false,
          cursor: { show: false },
          legend: { show: false },
          scales: { x: { time: false, range: (_u, _min, max) => [max - SPAN_S, max] }, y: { range: yRange } },
          series: [
            { label: 't [s]' },
            ...spec.curves.map((c) => ({ label: c.label, stroke: colour(c.colour), width: 1.5, points: { show: false } })),
          ],
          axes: [
            { ...axis, size: 24, values: (_u: uPlot, ticks: number[]) => ticks.map((x) => `${+x.toFixed(1)} s`) },
            { ...axis, size: 46, space: SPACE, values: (_u: uPlot, ticks: number[]) => ticks.map((x) => String(+x.toPrecision(6))) },
          ],
        },
        [[], ...spec.curves.map(() => [])],
        box,
      );
      new ResizeObserver(() => plot.setSize({ width: Math.max(160, box.clientWidth), height: HEIGHT })).observe(box);
      return plot;
    });
  }

  add(t: number, sample: Float64Array): void {
    if (this.paused) return;
    this.t.push(t);
    this.specs.forEach((s, i) => s.curves.forEach((c, j) => this.columns[i]![j]!.push(c.value(sample))));
    if (this.t.length > 1.2 * POINTS) {
      const cut = this.t.length - POINTS;
      this.t.splice(0, cut);
      for (const plot of this.columns) for (const column of plot) column.splice(0, cut);
    }
  }
  clear(): void {
    this.t.length = 0;
    for (const plot of this.columns) for (const column of plot) column.length = 0;
  }
  draw(): void {
    if (this.paused) return;
    this.plots.forEach((plot, i) => plot.setData([this.t, ...this.columns[i]!]));
  }
}
