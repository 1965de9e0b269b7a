export { EigenvalueDecomposition } from "ml-matrix";
