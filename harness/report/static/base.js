// What the other files share. All of them become one inline module (see page.py), so nothing here is global.

const SVG = "http://www.w3.org/2000/svg";

/** An element with attributes and children. Text goes in as text nodes, so nothing in the data can become markup. */
function make(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

/** The same for SVG. */
function draw(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** The JSON that Python left in an element. */
function dataOf(element) {
  return JSON.parse(element.querySelector('script[type="application/json"]').textContent);
}

/** Up to six significant digits, without the noise of sums of floating-point numbers; a true minus sign stays "-". */
function text(value) {
  return String(Number(value.toPrecision(6)));
}

/** With its sign, as Python's {:+g} writes it. */
function signed(value) {
  return (value < 0 ? "" : "+") + text(value);
}

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
