"""Speed and accuracy of the workbench beside general solvers, on one machine and one signal."""
