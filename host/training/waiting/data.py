import glob, numpy as np, torch
from safetensors.numpy import load_file
R='../data/'
def load(split):
    g=[];f=[];s=[]
    for p in sorted(glob.glob(R+split+'-1/*.safetensors')):
        d=load_file(p)
        g.append(d['grid']); f.append(d['forces_n']); 
    g=np.concatenate(g); f=np.concatenate(f)
    return torch.from_numpy(g), torch.from_numpy(f).permute(0,3,1,2).contiguous()
N=40
pos=(torch.arange(N).float()-(N-1)/2)/(N/2)
PX=pos[None,:].expand(N,N); PY=pos[:,None].expand(N,N)
def inputs(g):
    g=g.float()/16384.
    sq=(g[:,2]*(g[:,0]**2+g[:,1]**2)+g[:,5]*(g[:,3]**2+g[:,4]**2)).sum((1,2))
    w=(g[:,2]+g[:,5]).sum((1,2)).clamp_min(1.)
    rms=(sq/w).sqrt().clamp_min(0.002)
    r=rms[:,None,None]
    B=g.shape[0]
    x=torch.stack([g[:,0]/r,g[:,1]/r,g[:,2],g[:,3]/r,g[:,4]/r,g[:,5],PX.expand(B,N,N),PY.expand(B,N,N),(PX**2+PY**2).expand(B,N,N),torch.log(r/0.03).expand(B,N,N)],1)
    return x, rms
SCALE=1.5/0.05
def sym_grid(g,k):  # channels (x,y,c)*2 ; integer dtype
    mx,my,ex=k&1,k&2,k&4
    # moved[row,col] = src ; source: exchange first -> (col,row), then mirror
    # so build: mirror source, then transpose
    if mx: g=g.flip(-1); g=g.clone(); g[:,0::3]*=-1
    if my: g=g.flip(-2); g=g.clone(); g[:,1::3]*=-1
    if ex:
        g=g.transpose(-1,-2); g=g[:,[1,0,2,4,3,5]] if g.shape[1]==6 else g[:,[1,0,2]]
    return g
