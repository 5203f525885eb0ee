"""Reports of the proofs and studies: the writer that ``wakeflow verify`` uses.

A proof is a function ``run(slow=..., tell=...) -> Report``. Its tables are rows (mappings, see ``rows``) under columns
that are templates of a cell: ``Table("title", {"drag": "{cd:.3f}", "error %": "{error:.2g*100}"}, rows)``.
"""

from wakeflow.verify.report import NOTHING, Column, Report, Row, Table, Tell, cell

__all__ = ["NOTHING", "Column", "Report", "Row", "Table", "Tell", "cell"]
