% The two-link arm by your own equations and ode45, judged by twolink. MATLAB, or Octave: octave swing.m
% Angles of the URDF: q1 from the horizontal, q2 relative to the first link. Uniform rods of 3 kg and 1 kg, 1 m long.
m1 = 3; m2 = 1; L = 1; g = 9.81;
M = @(q) [m1*L^2/3 + m2*L^2*(4/3 + cos(q(2))), m2*L^2*(1/3 + cos(q(2))/2)
          m2*L^2*(1/3 + cos(q(2))/2),          m2*L^2/3];
h = @(q, v) [-m2*L^2*sin(q(2))*(v(1)*v(2) + v(2)^2/2) + (m1/2 + m2)*g*L*cos(q(1)) + m2*g*L/2*cos(q(1) + q(2))
             m2*L^2*sin(q(2))*v(1)^2/2 + m2*g*L/2*cos(q(1) + q(2))];
rate = @(t, x) [x(3:4); -M(x(1:2)) \ h(x(1:2), x(3:4))];
t = linspace(0, 2.5, 251);
[~, loose] = ode45(rate, t, zeros(4, 1), odeset('RelTol', 1e-3, 'AbsTol', 1e-6));  % MATLAB's defaults
[~, tight] = ode45(rate, t, zeros(4, 1), odeset('RelTol', 1e-10, 'AbsTol', 1e-10));

% The same motion by twolink, with an error bar on every sample.
system('twolink run arm-swing --accuracy 1e-9 --t-eval 0,1.25,2.5 --out arm.mat');
run = load('arm.mat');
at = [1 126 251];  % 0, 1.25 and 2.5 s
fprintf('ode45 is off by %.1e rad, at 1e-10 by %.1e; twolink by at most %.1e\n', ...
        max(max(abs(loose(at, 1:2) - run.q))), max(max(abs(tight(at, 1:2) - run.q))), max(run.error));

% A log for `twolink judge`: is it right, and where it is not, why?
file = fopen('ode45.csv', 'w');
fprintf(file, 't,q.shoulder,q.elbow,v.shoulder,v.elbow\n');
fprintf(file, '%.17g,%.17g,%.17g,%.17g,%.17g\n', [t; tight']);
fclose(file);
system('twolink judge arm-swing ode45.csv');

% Queries answer in JSON.
[~, answer] = system('twolink query two_link gravity-torque --q "shoulder=30deg" --json');
gravity = jsondecode(answer).g
