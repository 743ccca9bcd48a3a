// Small helpers of the page.

export function element(tag, properties = {}, ...children) {
  const { data, ...rest } = properties;
  const node = Object.assign(document.createElement(tag), rest);
  Object.assign(node.dataset, data);
  node.append(...children);
  return node;
}

export const byId = (id) => document.getElementById(id);

// Five significant digits, without an exponent where a person does not need one.
export function shown(value) {
  if (value == null || Number.isNaN(value)) return '–';
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 1e7) return String(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential(3);
  return String(Number(value.toPrecision(5)));
}

export function seconds(t) {
  return `${t.toFixed(Math.abs(t) < 10 ? 4 : 3)} s`;
}

export function save(name, content, type) {
  const link = element('a', { download: name, href: URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type })) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
