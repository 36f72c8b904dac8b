block {name} "Boom on pads, linear, with its extensions held at one of {S} places; written by pmr"
  parameter Integer place(min = 1, max = {S}) = 1 "which of the places" annotation(Evaluate = true);
  final parameter Real s[{S}, {P}]{unit} = {s} "{paths}";
  parameter Real x_start[{n}] = zeros({n}) "modal coordinates and their rates at the start";
{variables}
  Real x[{n}](start = x_start, each fixed = true) "modal coordinates and their rates";
protected
  final parameter Real A[{S}, {n}, {n}] = {A};
  final parameter Real B[{S}, {n}, {i}] = {B};
  final parameter Real C[{S}, {q}, {n}] = {C};
  final parameter Real D[{S}, {q}, {i}] = {D};
  Real f[{i}] "inputs in their order";
  Real y[{q}] "outputs in their order";
equation
  der(x) = A[place, :, :] * x + B[place, :, :] * f;
  y = C[place, :, :] * x + D[place, :, :] * f;
{equations}
end {name};
