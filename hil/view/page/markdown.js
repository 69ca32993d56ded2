// Instructions: headings, paragraphs, lists, **bold** and *italic* of Markdown. Everything else is shown as it stands.

function inline(text) {
  return text.split(/(\*\*[^*]+\*\*|\*[^*]+\*)/).filter(Boolean).map((part) => {
    const strong = part.length > 4 && part.startsWith("**") && part.endsWith("**");
    const weak = !strong && part.length > 2 && part.startsWith("*") && part.endsWith("*");
    if (!strong && !weak) return document.createTextNode(part);
    const element = document.createElement(strong ? "strong" : "em");
    element.textContent = part.slice(strong ? 2 : 1, strong ? -2 : -1);
    return element;
  });
}

function element(kind, text) {
  const made = document.createElement(kind);
  made.append(...inline(text));
  return made;
}

/** Elements of a text. */
export function markdown(text) {
  return text.trim().split(/\n\s*\n/).flatMap((block) => {
    const lines = block.split("\n").map((line) => line.trim()).filter(Boolean);
    const found = [];
    while (lines.length && /^#{1,4} /.test(lines[0])) found.push(element("h3", lines.shift().replace(/^#+ /, "")));
    if (!lines.length) return found;
    if (lines.every((line) => /^([-*]|\d+\.) /.test(line))) {
      const list = document.createElement(/^\d/.test(lines[0]) ? "ol" : "ul");
      list.append(...lines.map((line) => element("li", line.replace(/^([-*]|\d+\.) /, ""))));
      return [...found, list];
    }
    return [...found, element("p", lines.join(" "))];
  });
}
