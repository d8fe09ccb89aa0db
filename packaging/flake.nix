# Nix flake, not built by the project's checks. In the root: nix build "git+file:$PWD?dir=packaging"
{
  description = "Contact dynamics of rigid grains, with a Python module that reads and runs cases";

  inputs.nixpkgs.url = "github:NixOS/nixpkgs/nixos-unstable";

  outputs = { self, nixpkgs }:
    let
      systems = [ "x86_64-linux" "aarch64-linux" "x86_64-darwin" "aarch64-darwin" ];
      forEachSystem = make: nixpkgs.lib.genAttrs systems (system: make nixpkgs.legacyPackages.${system});
      version = (nixpkgs.lib.importTOML ../Cargo.toml).workspace.package.version;
    in
    {
      packages = forEachSystem (pkgs: rec {
        programs = pkgs.rustPlatform.buildRustPackage {
          pname = "cd-toolchain-programs";
          inherit version;
          src = ../.;
          cargoLock.lockFile = ../Cargo.lock;
          cargoBuildFlags = [ "--bin" "cd-pre" "--bin" "cd-solve" "--bin" "cd-post" ];
          doCheck = false;
        };

        default = pkgs.python3Packages.buildPythonPackage {
          pname = "cd-toolchain";
          inherit version;
          src = ../.;
          pyproject = true;
          build-system = with pkgs.python3Packages; [ hatchling packaging ];
          dependencies = [ pkgs.python3Packages.numpy ];
          env.CD_BIN = "${programs}/bin";
          pythonImportsCheck = [ "cd_toolchain" ];
        };
      });
    };
}
