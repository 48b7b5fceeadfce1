"""The report page: one file that opens from disk and needs nothing else.

`contents` gathers what is shown as plain data; ``template.html``, ``page.css`` and the scripts show
it. A new panel is a function here, a section in the template and a call in ``start.js``.
"""

from tomoslam_stage.comparison.page.contents import contents
from tomoslam_stage.comparison.page.writing import write_page

__all__ = ["contents", "write_page"]
