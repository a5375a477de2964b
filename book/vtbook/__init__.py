"""What the book's pages are made of: its experiments, claims, figures, tables and panels.

``vtlib`` is the method, ``vtlab`` what runs experiments; neither knows anything of these.
"""

import torch

# A page is an application, which may decide this for its process, wherever it is opened: with more
# threads tensors as small as these take longer, many times as long where processors are busy.
torch.set_num_threads(1)
