// The motion files of the robot: opened, saved, and their list.

import { element, say } from './element.js';

export class Files {
  // `text` returns the present text, and `opened` gets that of a file and its name.
  constructor(link, nodes, { text, opened }) {
    Object.assign(this, { link, nodes });
    nodes.open.onclick = () => this.go(async () => {
      const file = nodes.file.value;
      opened((await link.call('/sim/open', { file })).text, file);
      this.name(file);
      return `${file} is opened.`;
    });
    nodes.save.onclick = () => this.go(async () => {
      const file = nodes.name.value.trim();
      await link.call('/sim/save', { file, text: text(), replace: nodes.replace.checked });
      nodes.replace.checked = false;
      await this.list();
      nodes.file.value = file;
      return `${file} is saved.`;
    });
  }

  name(file) { this.nodes.name.value = file; }

  // Does something, and says what has come of it.
  async go(work) {
    const { said } = this.nodes;
    try {
      said.className = '';
      say(said, await work());
    } catch (error) {
      said.className = 'bad';
      say(said, error.message);
    }
  }

  // Lists the files anew.
  async list() {
    const { files } = await this.link.call('/sim/motions', {});
    const { file } = this.nodes, chosen = file.value;
    file.replaceChildren(...files.map(textContent => element('option', { textContent })));
    if (files.includes(chosen)) file.value = chosen;
  }
}
